"""A load frame for the contract tests, and the functions that cause its faults."""

from dataclasses import dataclass

from drivers.clock import Clock
from drivers.interfaces import LoadFrame
from drivers.testing.common import Counter, Handle, wait_until


@dataclass(frozen=True)
class LoadFrameBench:
    """A newly opened load frame that stands still at 0 N and 0 mm, with functions that cause faults.

    Attributes
    ----------
    load_frame : LoadFrame
        The load frame, with a specimen that reaches 2 kN within 1 mm. The limits of the machine must allow
        this load and this displacement.
    clock : Clock
        The clock of the machine's motion.
    load_tolerance_n, displacement_tolerance_mm : float
        Largest distance of a stopped machine from its target, in N and in mm.
    duration_tolerance : float
        Largest relative difference between the duration of a motion and the duration at the commanded rate.
    commands : callable, optional
        ``commands()`` returns the number of motion commands that the machine has executed, without holds.
    lose_answers, restore : callable, optional
        ``lose_answers()`` loses all answers of the machine, which still executes commands. ``restore()``
        restores normal operation.
    break_load_cell, freeze : callable, optional
        ``break_load_cell()`` makes the load NaN. ``freeze()`` freezes the readings and the sample counter.
    press_estop, release_estop : callable, optional
        Functions that press and release the emergency stop.
    watchdog_s : float, optional
        Time in s without a reading after which the machine itself stops a motion.
    stick_speed : callable, optional
        ``stick_speed()`` makes the machine confirm each later change of speed and keep its speed.
    """

    load_frame: LoadFrame
    clock: Clock
    load_tolerance_n: float = 2.0
    displacement_tolerance_mm: float = 1e-3
    duration_tolerance: float = 0.25
    commands: Counter | None = None
    lose_answers: Handle | None = None
    restore: Handle | None = None
    break_load_cell: Handle | None = None
    freeze: Handle | None = None
    press_estop: Handle | None = None
    release_estop: Handle | None = None
    watchdog_s: float | None = None
    stick_speed: Handle | None = None

    def arrive(self) -> float:
        """Wait until the crosshead stands still, and return the duration of the wait in seconds."""
        start_s = self.clock.now_s()
        wait_until(lambda: not self.load_frame.read().moving, self.clock)
        return self.clock.now_s() - start_s
