"""A repeated stop command, and its deadline in real and in simulated time."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from drivers.clock import Clock, SystemClock
from drivers.errors import DeviceError, DeviceTimeout, LinkLost


@dataclass(frozen=True)
class StopTimes:
    """Times for a stop or hold command, which is repeated until the device confirms it."""

    # time limit for the confirmation, in seconds. Afterwards the driver asks for the emergency stop.
    deadline_s: float = 5.0
    # longest wait for the answer to one stop command, in seconds, even if the rig file allows a longer wait
    answer_s: float = 1.0
    poll_s: float = 0.02  # pause, in seconds, between two attempts to stop the device


STOP_TIMES = StopTimes()


class StopDeadline:
    """A deadline on the rig's clock and on the system's clock, which passes when either clock reaches it.

    Two clocks are needed on a simulated rig. While the program waits for a real line, the simulated clock
    stands still. During a simulated sleep, the system's clock hardly advances.

    `clock` is the rig's clock. The second clock is the system's clock. `duration_s` is the time from now to
    the deadline, in seconds.
    """

    def __init__(self, clock: Clock, duration_s: float) -> None:
        self._ends = [(each, each.now_s() + duration_s) for each in (clock, SystemClock())]

    @property
    def passed(self) -> bool:
        """True if the deadline has passed on the rig's clock or on the system's clock."""
        return any(clock.now_s() >= end_s for clock, end_s in self._ends)


def stop_until_confirmed(
    name: str,
    stop_once: Callable[[], str],
    clock: Clock,
    times: StopTimes = STOP_TIMES,
    on_lost: Callable[[], object] = lambda: None,
) -> None:
    """Command a stop again and again until the device confirms it.

    ``stop_once()`` commands a stop once, and returns an empty text if the device stands still, otherwise the
    reason why this is not certain. ``on_lost()`` is called after a `LinkLost`, to open the line again. Both
    may raise `DeviceError`. `name` is the device's name and port.

    Raise `DeviceTimeout` if the device does not confirm the stop before the deadline of the stop.
    """
    deadline, got = StopDeadline(clock, times.deadline_s), "silence"
    while not deadline.passed:
        try:
            if not (got := stop_once()):
                return
        except LinkLost as lost:
            got = lost.got
            try:
                on_lost()
            except DeviceError as error:
                got = error.got
        except DeviceError as error:
            got = error.got
        clock.sleep(times.poll_s)
    raise DeviceTimeout(name, "stop", "standstill", got, "press the emergency stop")


@contextmanager
def calling_for_the_emergency_stop(name: str) -> Iterator[None]:
    """Replace a `LinkLost` error during a stop by an error that asks for the emergency stop.

    `name` is the device's name and port, used in the error message.
    """
    try:
        yield
    except LinkLost as lost:
        raise LinkLost(name, "stop", "standstill", lost.got, "press the emergency stop") from lost
