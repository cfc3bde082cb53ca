"""A driver with a simulated device behind it, and what is true of that device.

A bench is opened, given a fault, used, and closed; each use is one call of the driver.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any

from drivers.clock import VirtualClock
from drivers.interfaces import OpenContext
from drivers.lines.stop_deadline import StopTimes
from simulators.wire.faults import FaultPanel

STOP_TIMES = StopTimes(deadline_s=0.7)
"""How a stop or hold is repeated here; in use for 5 s."""


class WrongAnswerError(AssertionError):
    """A driver said something that is not so: worse than any error."""


class UnprovenError(AssertionError):
    """A driver that says it cannot prove its answers gave one that is not so."""


class ReportedFault(Exception):
    """A reading that is good and tells of a fault of the machine."""

    def __init__(self, faults: tuple[str, ...]) -> None:
        self.faults = faults
        super().__init__(", ".join(faults))


class Bench(ABC):
    """One driver and its device.

    Attributes
    ----------
    faults : FaultPanel
    uses : dict of str to callable
        What is tried under a fault, in this order; each raises `DeviceError`, or `WrongAnswerError` if the
        driver calls something good that is not.
    ways_back : dict of str to callable
        What a person may have to do once the fault is gone, the least first.
    unproven : frozenset of str
        The faults under which the protocol of the line cannot tell an old answer from a new one.
    talks_on_opening : bool
        Whether opening the driver sends messages that a fault can strike.
    """

    faults: FaultPanel
    uses: dict[str, Callable[[], object]]
    ways_back: dict[str, Callable[[], object]]
    unproven: frozenset[str] = frozenset()
    talks_on_opening = True

    def __init__(self) -> None:
        self.clock = VirtualClock()
        self.driver: Any = None

    def open(self) -> None:
        """Open the driver, closing the one before."""
        self.shut()
        self.driver = self.opened(OpenContext("device", self.clock))

    def shut(self) -> None:
        """Close the driver."""
        if self.driver is not None:
            self.driver.close()
        self.driver = None

    @abstractmethod
    def opened(self, context: OpenContext) -> Any:
        """Return the driver, opened."""

    @abstractmethod
    def prepare(self) -> None:
        """Make ready for what is tried."""

    def set_in_motion(self) -> None:
        """Begin a motion of many seconds, and let one pass; a camera films all the time."""
        self.clock.sleep(1.0)

    @abstractmethod
    def works(self) -> None:
        """Show that all is well: read, and carry out a motion."""

    def executed_twice(self) -> list[str]:
        """Return the commands that the device executed more often than they were given."""
        return []

    def left_behind(self) -> dict[str, int]:
        """Return how many of what the driver should have released are held after closing."""
        return {}

    def close(self) -> None:
        """Close driver and device."""
        self.shut()
