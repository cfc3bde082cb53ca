"""Finding cameras through Aravis, on a fake library; `tests/real_cameras/gige` finds a real camera."""

import tomllib

import pytest

import rig.commands.devices
from drivers.cameras.aravis.find import vision_cameras
from drivers.lines.serial_ports import FoundCamera
from rig.commands.devices import search
from rig.rigfile import read_rig

CAMERAS = [
    ("Maker-7", "Maker", "Mono", "7", "GigEVision", "192.0.2.7"),
    ("Other-8", "Other", "Usb", "8", "USB3Vision", "USB3"),
    ("Fake_1", "Aravis", "Fake", "1", "Fake", "0.0.0.0"),
]
FACTS = ("id", "vendor", "model", "serial_nbr", "protocol", "address")


class Library:
    """Knows cameras once it was told to look."""

    def __init__(self) -> None:
        self.cameras: list[tuple[str, ...]] = []

    def call(self, name: str, *arguments: int) -> int:
        if name == "update_device_list":
            self.cameras = CAMERAS
            return 0
        assert name == "get_n_devices"
        return len(self.cameras)

    def text(self, name: str, index: int) -> str:
        return self.cameras[index][FACTS.index(name.removeprefix("get_device_"))]


def test_cameras_on_networks_and_buses_are_found_and_aravis_own_left_out():
    assert vision_cameras(Library()) == [
        FoundCamera("aravis", "Maker-7", "Maker Mono 7 (GigEVision at 192.0.2.7)"),
        FoundCamera("aravis", "Other-8", "Other Usb 8 (USB3Vision at USB3)"),
    ]


@pytest.fixture
def alone(monkeypatch):
    monkeypatch.setattr(rig.commands.devices, "video_nodes", list)
    monkeypatch.setattr(rig.commands.devices, "serial_ports", list)


def test_the_rig_file_to_start_from_names_the_driver_that_films(alone, monkeypatch, tmp_path):
    monkeypatch.setattr(rig.commands.devices, "vision_cameras", lambda: vision_cameras(Library()))
    found = search([], [], ask=True)
    assert found.lines()[0] == "camera Maker-7: Maker Mono 7 (GigEVision at 192.0.2.7)"
    path = tmp_path / "rig.toml"
    decided = "width_px = 640\nheight_px = 480\nrate_hz = 25.0\nexposure_us = 5000.0\n# format"
    path.write_text(found.rig_file().replace("# format", decided))
    cameras = read_rig(path).cameras
    assert [camera.driver for camera in cameras.values()] == ["aravis", "aravis"]
    assert cameras["camera_0"].setting("camera") == "Maker-7"


def test_what_was_not_looked_for_is_said(alone, monkeypatch):
    def missing() -> list[FoundCamera]:
        raise OSError("libaravis-0.8.so.0: cannot open shared object file")

    monkeypatch.setattr(rig.commands.devices, "vision_cameras", missing)
    (told,) = (line for line in search([], [], ask=True).lines() if "Vision" in line)
    assert "libaravis-0.8.so.0" in told
    assert told.endswith("apt install libaravis-0.8-0")
    assert "GigE Vision and USB3 Vision cameras: not asked" in search([], [], ask=False).lines()


def test_a_camera_cannot_write_into_the_rig_file_by_its_name(alone, monkeypatch):
    spiteful = FoundCamera("aravis", "Maker-7", "Maker\n[stage]\x1b[2J")
    monkeypatch.setattr(rig.commands.devices, "vision_cameras", lambda: [spiteful])
    content = tomllib.loads(search([], [], ask=True).rig_file())
    assert set(content) == {"rig", "cameras", "operator"}
