"""A table of triggers may name a camera of the rig, whose own output line then gives the pulses."""

from dataclasses import dataclass, field

import pytest

from drivers.clock import VirtualClock
from drivers.errors import ConfigurationError
from drivers.interfaces import CameraInfo
from drivers.registry import DriverSpec
from drivers.settings import Settings
from rig.devices import open_rig
from rig.rigfile import DeviceEntry, RigFile, TriggerEntry, read_rig
from tests.rig.test_devices import rig_file

RIG = """
[rig]
name = "beside a closed machine"
[cameras.off_axis]
driver = "aravis"
camera = "192.168.0.7"
width_px = 64
height_px = 48
rate_hz = 10.0
exposure_us = 100.0
output = "Line2"
output_source = "UserOutput1"
[cameras.on_axis]
driver = "opencv-camera"
source = "0"
width_px = 64
height_px = 48
rate_hz = 10.0
[operator]
driver = "console-operator"
[triggers.logger]
camera = "cameras.off_axis"
"""


def read(tmp_path, *changes: tuple[str, str]) -> RigFile:
    text = RIG
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = tmp_path / "rig.toml"
    path.write_text(text)
    return read_rig(path)


def test_a_camera_gives_the_pulses_of_an_event(tmp_path):
    assert read(tmp_path).triggers == {"logger": TriggerEntry(None, "exposure", "off_axis")}
    later = ('"cameras.off_axis"', '"cameras.off_axis"\nat = "step"')
    assert read(tmp_path, later).triggers["logger"].at == "step"


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (('= "cameras.off_axis"', '= "cameras.of_axis"'), "triggers.logger.camera: one of cameras.off_axis"),
        (('= "cameras.off_axis"', '= "off_axis"'), "triggers.logger.camera: "),
        (('= "cameras.off_axis"', '= "cameras.on_axis"'), "a camera whose line the program drives"),
        (('output_source = "UserOutput1"\n', ""), "a camera whose line the program drives"),
        (('= "cameras.off_axis"', '= "cameras.off_axis"\nwidth_s = 0.1'), "triggers.logger.width_s: unknown"),
        (('= "cameras.off_axis"', '= "cameras.off_axis"\nat = "noon"'), "triggers.logger.at: "),
        (("triggers.logger", 'triggers."a logger"'), "a name of letters, digits and _"),
        (
            ("[triggers.logger]", '[triggers.second]\ncamera = "cameras.off_axis"\n[triggers.logger]'),
            "one table is expected for the line of cameras.off_axis, got 2",
        ),
    ],
)
def test_a_camera_that_cannot_give_pulses_is_a_mistake(tmp_path, change, said):
    with pytest.raises(ConfigurationError) as raised:
        read(tmp_path, change)
    assert said in str(raised.value)


@dataclass
class Flashing:
    """A camera with an output line."""

    info: CameraInfo = field(default_factory=lambda: CameraInfo("maker", "model", "1"))
    pulses: int = 0

    def pulse(self) -> None:
        self.pulses += 1

    def close(self) -> None:
        """Nothing is to be closed."""


def test_the_line_is_that_of_the_camera_that_is_open_now():
    made: list[Flashing] = []

    def open_camera(_, __) -> Flashing:
        made.append(Flashing())
        return made[-1]

    files = rig_file([], {}, environment=False)
    files.cameras["front"] = DeviceEntry(
        "cameras.front", "fake", DriverSpec("camera", Settings, open_camera), Settings()
    )
    files.triggers["logger"] = TriggerEntry(None, "step", "front")
    with open_rig(files) as rig:
        line = rig.triggers["logger"].device
        line.pulse()
        rig.reopen["front"]()
        line.pulse()
        line.pulse()
        line.close()
        assert [camera.pulses for camera in made] == [1, 2]
        assert (line.info.vendor, line.info.model) == ("maker", "output line of model")


def test_a_camera_that_does_not_open_has_no_line():
    files = rig_file([], {}, broken="on_axis")
    files.triggers["logger"] = TriggerEntry(None, "step", "on_axis")
    failed: dict[str, str] = {}
    with open_rig(files, failed=failed) as rig:
        assert rig.triggers == {}
        assert isinstance(rig.clock, VirtualClock)
    assert list(failed) == ["on_axis"]
