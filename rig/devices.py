"""Open the devices of a rig file, and close every opened device in any case."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import Any

from drivers.clock import Clock, SystemClock
from drivers.interfaces import Camera, DeviceInfo, LoadFrame, OpenContext, Operator, RotationStage
from rig.rigfile import DeviceEntry, RigFile


@dataclass(frozen=True)
class Rig:
    """The opened devices. Cameras are named as in the rig file; a rig has a stage, a load frame, or both."""

    clock: Clock
    operator: Operator
    cameras: dict[str, Camera]
    stage: RotationStage | None = None
    load_frame: LoadFrame | None = None
    virtual: bool = False

    @property
    def simulated(self) -> bool:
        """Whether anything in this rig is not real."""
        infos: list[DeviceInfo] = [camera.info for camera in self.cameras.values()]
        infos += [device.info for device in (self.stage, self.load_frame) if device is not None]
        return self.virtual or any(info.simulated for info in infos)


@contextmanager
def open_rig(rig_file: RigFile) -> Iterator[Rig]:
    """Open every device of a rig file, the simulated environment first, and close them in reverse order.

    Closing moves and stops nothing: the engine makes the rig safe before.

    Raises
    ------
    DeviceError
        If a device cannot be opened; those opened before are closed.
    """
    with ExitStack() as stack:
        clock: Clock = SystemClock()
        environment = None
        if rig_file.simulation is not None:
            environment = _open(rig_file.simulation, clock, None, stack)
            clock = environment.clock

        def opened(entry: DeviceEntry | None) -> Any:
            return None if entry is None else _open(entry, clock, environment, stack)

        stage, load_frame = opened(rig_file.stage), opened(rig_file.load_frame)
        cameras = {name: opened(entry) for name, entry in rig_file.cameras.items()}
        operator = opened(rig_file.operator)
        virtual = rig_file.simulated or environment is not None
        yield Rig(clock, operator, cameras, stage, load_frame, virtual=virtual)


def _open(entry: DeviceEntry, clock: Clock, environment: Any, stack: ExitStack) -> Any:
    device = entry.spec.open(entry.settings, OpenContext(entry.name, clock, environment))
    if hasattr(device, "close"):  # an operator has nothing to release
        stack.callback(device.close)
    return device
