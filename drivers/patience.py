"""How long a stop may be repeated: a deadline that holds on a simulated clock and on a silent line alike."""

from drivers.clock import Clock, SystemClock


class Patience:
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
    def exhausted(self) -> bool:
        """True once the time is over."""
        return any(clock.now_s() >= end_s for clock, end_s in self._ends)
