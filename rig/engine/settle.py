"""Wait until load, displacement or angle has settled, with a deadline."""

from collections.abc import Callable

from drivers.clock import Clock
from rig.errors import SettleTimeout
from rig.protocol.step import RigReading


def settle(
    read: Callable[[], RigReading],
    within: Callable[[RigReading], bool],
    *,
    dwell_s: float,
    timeout_s: float,
    poll_s: float,
    clock: Clock,
    pause: Callable[[float], None],
    step: str,
    expected: str,
) -> RigReading:
    """Read until every reading was within tolerance for `dwell_s` seconds, and return the last reading.

    `read` takes a reading, `within` judges whether it is within its tolerance, and `pause` lets time pass. An
    exception of `read` ends the wait at once. `dwell_s`, `timeout_s` and `poll_s` are the length of the
    dwell, the time limit for the whole wait, and the time between two readings, in s. `step` and `expected`
    are for the message of `SettleTimeout`, which is raised if the deadline passes before the readings have
    settled.
    """
    deadline_s = clock.now_s() + timeout_s
    entered_s: float | None = None
    while True:
        reading = read()
        # Use the times of the readings and not the clock, so that a replay makes the same decisions.
        if not within(reading):
            entered_s = None
        elif entered_s is None:
            entered_s = reading.time_s
        elif reading.time_s - entered_s >= dwell_s:
            return reading
        if clock.now_s() >= deadline_s:
            raise SettleTimeout(
                step,
                f"{expected} for {dwell_s:g} s within {timeout_s:g} s",
                _describe(reading),
                f"check the device, or raise settle.timeout_s above {timeout_s:g} or the tolerance",
            )
        pause(poll_s)


def _describe(reading: RigReading) -> str:
    shown = ", ".join(f"{value:.6g} {unit}" for unit, value in reading.by_unit().items())
    return f"{shown} ({'moving' if reading.moving else 'not moving'})"
