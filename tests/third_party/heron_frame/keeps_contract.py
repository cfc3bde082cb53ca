"""The test suite of the third party's package: contract tests of the load frame, and a test of its guard."""

from collections.abc import Iterator
from contextlib import ExitStack, closing
from functools import partial

import pytest
from heron_frame import SPEC, HeronFrame, HeronSettings
from heron_machine import HeronMachine

from drivers.clock import VirtualClock
from drivers.errors import LinkLost
from drivers.interfaces import OpenContext
from drivers.testing import LoadFrameBench, LoadFrameContract
from simulators.load_frame.device import SpeedFault

LIMITS = {"load_max_n": 5000.0, "displacement_max_mm": 5.0}


@pytest.fixture
def machine() -> Iterator[HeronMachine]:
    with closing(HeronMachine(VirtualClock())) as machine:
        yield machine


class TestHeronFrame(LoadFrameContract):
    @pytest.fixture
    def bench(self, machine: HeronMachine) -> Iterator[LoadFrameBench]:
        settings = HeronSettings(port=machine.address, reply_timeout_s=0.2, **LIMITS)
        device = machine.device
        context = OpenContext("load_frame", machine.clock)
        with closing(HeronFrame(settings, context)) as frame:
            yield LoadFrameBench(
                frame,
                context.clock,
                commands=lambda: machine.motions,
                lose_answers=partial(machine.faults.switch_on, "drop"),
                restore=machine.faults.clear,
                break_load_cell=lambda: device.break_load_cell(True),
                freeze=device.freeze,
                press_estop=device.press_estop,
                release_estop=device.release_estop,
                stick_speed=partial(device.spoil_speed, SpeedFault.STUCK),
            )


def test_the_guard_stops_a_motion_that_the_driver_began(machine: HeronMachine) -> None:
    settings, clock = HeronSettings(port=machine.address, **LIMITS), machine.clock
    with ExitStack() as opened:
        guard = opened.enter_context(closing(SPEC.guard.open(settings, OpenContext("load_frame", clock))))
        context = OpenContext("load_frame", clock, relay=guard.relay)
        frame = opened.enter_context(closing(HeronFrame(settings, context)))
        frame.go_to_displacement(2.0, 0.1)
        clock.sleep(1.0)
        assert frame.read().moving
        guard.stop()
        assert not machine.device.read().moving
        assert 0.0 < machine.device.displacement_mm() < 2.0
        with pytest.raises(LinkLost):
            frame.go_to_displacement(2.0, 0.1)
        guard.close()
        frame.hold()
