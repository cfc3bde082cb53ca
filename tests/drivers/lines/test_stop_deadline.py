"""A stop is repeated until the device confirms it, and otherwise asks for the emergency stop."""

import pytest

from drivers.errors import DeviceFault, DeviceTimeout, LinkLost
from drivers.lines.stop_deadline import StopTimes, stop_until_confirmed

TIMES = StopTimes(deadline_s=1.0, poll_s=0.1)


def stop_with(clock, *outcomes):
    """Stop a device whose attempts have these outcomes; return how often it was stopped and reopened."""
    left, stops, openings = list(outcomes), [], []

    def stop_once() -> str:
        stops.append(clock.now_s())
        outcome = left.pop(0) if left else "a motion"
        if isinstance(outcome, Exception):
            raise outcome
        return outcome

    def reopen() -> None:
        openings.append(clock.now_s())
        if len(openings) == 1:
            raise LinkLost("frame", "open port", "a port", "none", "plug it in")

    try:
        stop_until_confirmed("frame", stop_once, clock, TIMES, reopen)
    finally:
        counted = len(stops), len(openings)
    return counted


def test_a_confirmed_stop_is_commanded_once(clock):
    assert stop_with(clock, "") == (1, 0)


def test_it_goes_on_after_silence_a_fault_and_a_lost_line(clock):
    lost = LinkLost("frame", "send", "a port", "gone", "check it")
    silence = DeviceTimeout("frame", "send", "an answer", "silence", "check it")
    fault = DeviceFault("frame", "send", "acceptance", "busy", "wait")
    assert stop_with(clock, "a motion", silence, lost, lost, fault, "") == (6, 2)


def test_a_stop_that_is_never_confirmed_asks_for_the_emergency_stop(clock):
    with pytest.raises(DeviceTimeout, match="got a motion; press the emergency stop"):
        stop_with(clock)
    assert clock.now_s() == pytest.approx(1.0, abs=0.2)
