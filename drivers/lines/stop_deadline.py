"""The deadline of a repeated stop, which works on a simulated clock and on a silent line."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from drivers.clock import Clock, SystemClock
from drivers.errors import LinkLost


@dataclass(frozen=True)
class StopTimes:
    """How a stop or a hold is repeated until the device confirms it.

    Attributes
    ----------
    deadline_s : float
        A stop not confirmed within this time has failed; only the emergency stop is left.
    answer_s : float
        Time limit for the answer to one try, even if the rig file allows other answers more time.
    poll_s : float
        Pause between two tries.
    """

    deadline_s: float = 5.0
    answer_s: float = 1.0
    poll_s: float = 0.02


STOP_TIMES = StopTimes()


class StopDeadline:
    """A deadline that has passed as soon as the rig's clock or the system's clock is past it.

    A virtual clock does not advance during the wait on a real line. The system's clock does not advance
    during a simulated sleep.

    Parameters
    ----------
    clock : Clock
        The rig's clock.
    duration_s : float
    """

    def __init__(self, clock: Clock, duration_s: float) -> None:
        self._ends = [(each, each.now_s() + duration_s) for each in (clock, SystemClock())]

    @property
    def passed(self) -> bool:
        """True once the time is over."""
        return any(clock.now_s() >= end_s for clock, end_s in self._ends)


@contextmanager
def calling_for_the_emergency_stop(name: str) -> Iterator[None]:
    """Turn a link lost during a stop into an error that asks for the emergency stop.

    Parameters
    ----------
    name : str
        The device's name and port, for the message.
    """
    try:
        yield
    except LinkLost as lost:
        raise LinkLost(name, "stop", "standstill", lost.got, "press the emergency stop") from lost
