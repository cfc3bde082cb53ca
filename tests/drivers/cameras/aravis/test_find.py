"""Tests of the search for cameras with a simulated Aravis library. `tests/real_cameras/gige` finds a real
one."""

import pytest

from drivers.cameras.aravis import find
from drivers.cameras.aravis.library import Aravis
from drivers.registry import Found

CAMERAS = [
    ("Maker-7", "Maker", "Mono", "7", "GigEVision", "192.0.2.7"),
    ("Other-8", "Other", "Usb", "8", "USB3Vision", "USB3"),
    ("Fake_1", "Aravis", "Fake", "1", "Fake", "0.0.0.0"),
]
FACTS = ("id", "vendor", "model", "serial_nbr", "protocol", "address")


class Library:
    """A library that knows its cameras only after it was told to search for them."""

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
    assert find.vision_cameras(Library()) == [
        Found("Maker Mono 7 (GigEVision at 192.0.2.7)", {"camera": "Maker-7"}),
        Found("Other Usb 8 (USB3Vision at USB3)", {"camera": "Other-8"}),
    ]


def test_a_machine_without_the_library_is_told_what_to_install(monkeypatch):
    def missing() -> Aravis:
        raise OSError("libaravis-0.8.so.0: cannot open shared object file")

    monkeypatch.setattr(find, "load", missing)
    with pytest.raises(OSError, match=r"libaravis-0\.8\.so\.0.*; apt install libaravis-0\.8-0$"):
        find.vision_cameras()
