"""How long a stop is repeated: a deadline that holds on a simulated clock and on a silent line alike."""

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
        Unconfirmed after so long, it has failed: only the emergency stop is left.
    answer_s : float
        How long one try waits for its answer, even if the rig file lets other answers take longer.
    poll_s : float
        From the end of one try to the next.
    """

    deadline_s: float = 5.0
    answer_s: float = 1.0
    poll_s: float = 0.02


STOP_TIMES = StopTimes()


class StopDeadline:
    """A deadline that has passed when either the rig's clock or the machine's own is past it.

    On a virtual clock no time passes while a real line is silent; on the machine's clock none passes while
    simulated time is slept away.

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
    """Turn a link that is lost during a stop into what it means: nobody knows whether the device still moves.

    Parameters
    ----------
    name : str
        The device's name and port, for the message.
    """
    try:
        yield
    except LinkLost as lost:
        raise LinkLost(name, "stop", "standstill", lost.got, "press the emergency stop") from lost
