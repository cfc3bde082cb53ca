"""The guardian is told about each motion, and about each change of its speed, before it begins."""

from typing import Any, cast

from drivers.clock import VirtualClock
from rig.devices import Rig
from rig.guardian.announced import announce


class Told:
    """A guardian, and a load frame that changes its speed: both note their calls in one list."""

    def __init__(self) -> None:
        self.calls: list[str] = []

    def about_to_move(self) -> None:
        self.calls.append("told")

    def waiting_for_a_person(self) -> None:
        self.calls.append("waits")

    def go_to_displacement(self, displacement_mm: float, speed_mm_s: float) -> None:
        self.calls.append("go")

    def change_speed(self, speed_mm_s: float) -> None:
        self.calls.append(f"speed {speed_mm_s:g}")

    def hold(self) -> None:
        self.calls.append("hold")


class Plain:
    """A load frame that keeps the speed of each motion."""


def announced(load_frame: object, guardian: Told) -> Any:
    rig = Rig(VirtualClock(), cast(Any, object()), {}, load_frame=cast(Any, load_frame))
    return announce(rig, cast(Any, guardian)).load_frame


def test_a_change_of_speed_is_told_before_it_is_sent_and_a_hold_is_not_delayed():
    both = Told()
    frame = announced(both, both)
    frame.go_to_displacement(1.0, 0.1)
    frame.change_speed(0.2)
    frame.hold()
    assert both.calls == ["told", "go", "told", "speed 0.2", "hold"]


def test_a_load_frame_does_not_gain_what_it_cannot_do():
    assert hasattr(announced(Told(), Told()), "change_speed")
    assert not hasattr(announced(Plain(), Told()), "change_speed")
