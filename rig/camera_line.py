"""The output line of a camera as a trigger output of the rig, and its table in the rig file."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

from pydantic import Field, ValidationError

from drivers.interfaces import Camera, DeviceInfo
from drivers.settings import Settings, mistakes_in


class CameraLine:
    """A `TriggerOutput` whose pulses a camera gives on its own output line.

    `camera` returns the camera as it is opened now: a camera that drops out during a run is opened again, and
    its line with it. The camera leaves the line at rest when it is closed.
    """

    def __init__(self, camera: Callable[[], Camera]) -> None:
        self._camera = camera
        info = camera().info
        self.info = DeviceInfo(
            info.vendor, f"output line of {info.model}", info.serial, simulated=info.simulated
        )

    def pulse(self) -> None:
        """Begin a pulse. Raise `DeviceError` if it may not have been given."""
        camera: Any = self._camera()
        camera.pulse()

    def close(self) -> None:
        """Do nothing: the rig closes the camera itself."""


class CameraLineTable(Settings):
    """The table of a trigger output in the rig file that belongs to a camera."""

    camera: str = Field(pattern=r"^cameras\.\w+$", description="camera of the rig, such as cameras.off_axis")


class WithSettings(Protocol):
    """Interface of an entry of the rig file."""

    def setting(self, name: str) -> Any:
        """Return the value of a setting, or None if there is no such setting."""


def camera_of_line(
    where: str, table: dict[str, Any], cameras: Mapping[str, WithSettings], mistakes: list[str]
) -> str:
    """Return the name of the camera whose line gives pulses, or an empty text after a mistake.

    `where` is the path of the table. Append a sentence for each mistake to `mistakes`.
    """
    try:
        camera = CameraLineTable.model_validate(table).camera.removeprefix("cameras.")
    except ValidationError as error:
        mistakes += mistakes_in(error, where)
        return ""
    if not where.partition(".")[2].isidentifier():
        mistakes.append(f"{where}: a name of letters, digits and _ is expected, such as logger")
    if camera not in cameras:
        known = ", ".join(f"cameras.{name}" for name in cameras) or "none"
        mistakes.append(f"{where}.camera: one of {known} is expected, got {table['camera']!r}; correct it")
        return ""
    if not cameras[camera].setting("gives_pulses"):
        mistakes.append(
            f"{where}.camera: a camera whose line the program drives is expected; give cameras.{camera} "
            'output and output_source = "UserOutput1", by the camera\'s own names'
        )
        return ""
    return camera


def mistakes_of_shared_lines(cameras: Sequence[str]) -> list[str]:
    """Return one sentence for each camera whose line several tables name."""
    return [
        f"triggers: one table is expected for the line of cameras.{camera}, got {count}; remove the others"
        for camera, count in Counter(cameras).items()
        if count > 1
    ]
