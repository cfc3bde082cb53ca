"""The simulated crosshead changes its speed in motion, along the ramp of its drive, and brakes at a hold."""

import numpy as np
import pytest

from simulators.load_frame.device import CONTROL_PERIOD_S, LoadFrameDevice
from simulators.load_frame.drive import DriveSettings
from simulators.load_frame.state import FaultCode, Refusal, RefusedError


class Air:
    """A load string without a specimen."""

    def stretch_to(self, displacement_mm: float) -> float:
        return 0.0

    def break_now(self) -> None: ...


@pytest.fixture
def frame(clock) -> LoadFrameDevice:
    made = LoadFrameDevice(clock, Air())
    # look between the control periods, so that rounding of the time skips none
    clock.sleep(CONTROL_PERIOD_S / 2)
    return made


def speeds(frame, clock, duration_s):
    """Return the speed in each control period."""
    found = []
    for _ in range(round(duration_s / CONTROL_PERIOD_S)):
        clock.sleep(CONTROL_PERIOD_S)
        found.append(frame.read().speed_mm_s)
    return np.array(found)


@pytest.mark.parametrize("speed_mm_s", [1e-4, 0.0015, 0.015, 0.4, 1.0, 10.0])
def test_every_speed_of_a_test_is_held_and_the_target_is_met(frame, clock, speed_mm_s):
    target_mm = 8.0 * speed_mm_s + 0.5 * speed_mm_s**2 / 20.0
    frame.go_to_displacement(target_mm, 0.5 * speed_mm_s)
    clock.sleep(1.0)
    frame.change_speed(speed_mm_s)
    clock.sleep(1.0)
    before_mm = frame.displacement_mm()
    clock.sleep(4.0)
    assert (frame.displacement_mm() - before_mm) / 4.0 == pytest.approx(speed_mm_s, rel=1e-6)
    clock.sleep(30.0)
    state = frame.read()
    assert (state.at_target, state.moving, state.speed_mm_s) == (True, False, 0.0)
    assert frame.displacement_mm() == pytest.approx(target_mm, rel=1e-12)


def test_no_period_changes_the_speed_by_more_than_the_drive_can(frame, clock):
    step_mm_s = 20.0 * CONTROL_PERIOD_S
    frame.go_to_displacement(90.0, 10.0)
    found = list(speeds(frame, clock, 1.0))
    assert found[-1] == pytest.approx(10.0)
    for speed_mm_s in (2.0, 7.0, 0.01, 10.0):
        frame.change_speed(speed_mm_s)
        found += list(speeds(frame, clock, 0.6))
        assert found[-1] == pytest.approx(speed_mm_s)
    frame.go_to_displacement(0.0, 10.0)
    found += list(speeds(frame, clock, 8.0))
    # in the period in which it arrives, the crosshead is said to stand
    found = [speed_mm_s for speed_mm_s in found if speed_mm_s]
    assert abs(found[-1]) < 2 * step_mm_s
    assert np.max(np.abs(np.diff([0.0, *found]))) <= step_mm_s * (1 + 1e-9)
    assert min(found) == pytest.approx(-10.0)
    assert frame.displacement_mm() == pytest.approx(0.0, abs=1e-12)
    assert frame.read().at_target


def test_a_hold_brakes_and_then_stands(frame, clock):
    frame.go_to_displacement(90.0, 10.0)
    clock.sleep(2.0)
    begun_mm = frame.displacement_mm()
    frame.hold()
    state = frame.read()
    assert (state.holding, state.moving) == (True, True)
    with pytest.raises(RefusedError) as refused:
        frame.change_speed(1.0)
    assert refused.value.reason is Refusal.NO_MOTION
    clock.sleep(1.0)
    assert frame.read().moving is False
    # v² / 2a, and half a period
    assert frame.displacement_mm() - begun_mm == pytest.approx(2.5, abs=10.0 * CONTROL_PERIOD_S)
    frame.go_to_displacement(0.0, 0.4)
    clock.sleep(1.0)
    frame.hold()
    assert frame.read().moving is False


def test_a_drive_with_a_lag_approaches_the_speed_exponentially(frame, clock):
    frame.fit_drive(DriveSettings(acceleration_mm_s2=1000.0, lag_s=0.2))
    frame.go_to_displacement(50.0, 1.0)
    clock.sleep(3.0)
    frame.change_speed(2.0)
    found = speeds(frame, clock, 1.0)
    times_s = CONTROL_PERIOD_S * np.arange(1, len(found) + 1)
    np.testing.assert_allclose(found, 2.0 - np.exp(-times_s / 0.2), rtol=1e-6)
    clock.sleep(60.0)
    assert frame.read().at_target
    assert frame.displacement_mm() == pytest.approx(50.0, abs=1e-9)


def test_the_speed_of_no_motion_cannot_be_changed(frame, clock):
    frame.set_watchdog(1.0)

    def refused(speed_mm_s=0.1):
        with pytest.raises(RefusedError) as caught:
            frame.change_speed(speed_mm_s)
        return caught.value.reason

    assert refused() is Refusal.NO_MOTION
    frame.go_to_displacement(5.0, 0.1)
    for speed_mm_s in (0.0, -0.1, 10.1, float("nan")):
        assert refused(speed_mm_s) is Refusal.TOO_FAST
    frame.change_speed(0.2)
    clock.sleep(5.0)
    assert frame.read().fault is FaultCode.WATCHDOG
    assert refused() is Refusal.NO_MOTION
    frame.go_to_load(0.0, 10.0)
    assert refused() is Refusal.NO_MOTION


def test_a_change_does_not_wait_with_the_watchdog(frame, clock):
    """Only a heartbeat does; a program that hangs in its control must be stopped."""
    frame.set_watchdog(1.0)
    frame.go_to_displacement(5.0, 0.1)
    for _ in range(3):
        clock.sleep(0.4)
        if frame.read().moving:
            frame.change_speed(0.2)
    assert frame.read().fault is FaultCode.WATCHDOG
