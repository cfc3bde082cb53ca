"""Wait until a value has settled, always with a deadline."""

from collections.abc import Callable

from drivers.clock import Clock
from rig.errors import SettleTimeout
from rig.protocol.step import Reading


def settle(
    read: Callable[[], Reading],
    within: Callable[[Reading], bool],
    *,
    dwell_s: float,
    timeout_s: float,
    poll_s: float,
    clock: Clock,
    step: str,
    expected: str,
) -> Reading:
    """Read until `within` has held at every reading for `dwell_s`, and return the last reading.

    Parameters
    ----------
    read : callable
        Takes a fresh reading; whatever it raises ends the wait at once.
    within : callable
        Whether a reading is within its tolerance.
    dwell_s, timeout_s, poll_s : float
        Length of the dwell, deadline for the whole wait, and time between two readings.
    clock : Clock
    step, expected : str
        For the message of the error.

    Raises
    ------
    SettleTimeout
        If the deadline passes first.
    """
    deadline_s = clock.now_s() + timeout_s
    entered_s: float | None = None
    while True:
        reading = read()
        now_s = clock.now_s()
        if not within(reading):
            entered_s = None
        elif entered_s is None:
            entered_s = now_s
        elif now_s - entered_s >= dwell_s:
            return reading
        if now_s >= deadline_s:
            raise SettleTimeout(
                step,
                f"{expected} for {dwell_s:g} s within {timeout_s:g} s",
                _describe(reading),
                f"check the device, or raise settle.timeout_s above {timeout_s:g} or the tolerance",
            )
        clock.sleep(poll_s)


def _describe(reading: Reading) -> str:
    shown = ", ".join(f"{value:.6g} {unit}" for unit, value in reading.by_unit().items())
    return f"{shown} ({'moving' if reading.moving else 'not moving'})"
