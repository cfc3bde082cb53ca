"""The base class of benches: a driver, its simulated device, and checks against the device's true state.

A test opens a bench, switches a fault on, uses the driver, and closes the bench. Each use is one call of the
driver.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any

from drivers.clock import VirtualClock
from drivers.interfaces import OpenContext
from drivers.lines.stop_deadline import StopTimes
from simulators.wire.faults import FaultPanel

STOP_TIMES = StopTimes(deadline_s=0.7)
"""Times of a stop or hold in these tests; the default deadline is 5 s."""


class WrongAnswerError(AssertionError):
    """A driver returned a wrong value without an error."""


class UnprovenError(AssertionError):
    """A driver returned a wrong value, but states in its documentation that it cannot detect this."""


class ReportedFault(Exception):
    """A correct reading that reports a fault of the machine."""

    def __init__(self, faults: tuple[str, ...]) -> None:
        self.faults = faults
        super().__init__(", ".join(faults))


class Bench(ABC):
    """One driver and its simulated device.

    Attributes
    ----------
    faults : FaultPanel
    uses : dict of str to callable
        The calls that are tried with a fault, in this order. Each call raises `DeviceError`, or
        `WrongAnswerError` if the driver returns a wrong value.
    ways_back : dict of str to callable
        Actions that may be necessary after the end of a fault, the smallest action first.
    unproven : frozenset of str
        The faults with which the protocol of the line cannot distinguish an old answer from a new one.
    talks_on_opening : bool
        True if opening the driver sends messages, which a fault can affect.
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
        """Close the driver if it is open, and open it again."""
        self.shut()
        self.driver = self.opened(OpenContext("device", self.clock))

    def shut(self) -> None:
        """Close the driver."""
        if self.driver is not None:
            self.driver.close()
        self.driver = None

    @abstractmethod
    def opened(self, context: OpenContext) -> Any:
        """Open the driver and return it."""

    @abstractmethod
    def prepare(self) -> None:
        """Prepare the device for the calls in `uses`, for example by homing."""

    def set_in_motion(self) -> None:
        """Begin a motion of many seconds, and let one second pass; a camera films all the time."""
        self.clock.sleep(1.0)

    @abstractmethod
    def works(self) -> None:
        """Check that the device works: read it, and execute a motion."""

    def executed_twice(self) -> list[str]:
        """Return the commands that the device has executed more often than the driver was called."""
        return []

    def left_behind(self) -> dict[str, int]:
        """Return, by kind, the number of resources that the driver has not released after closing."""
        return {}

    def close(self) -> None:
        """Close driver and device."""
        self.shut()
