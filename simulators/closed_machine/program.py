"""The position of the crosshead as a function of time, as the machine's program gives it."""

from collections.abc import Sequence

import numpy as np

from simulators.closed_machine.settings import ProgramStep


class Program:
    """A program of motions at constant speed and of waits. It begins at the position 0.

    Times are in seconds since the machine was switched on. `start_s` is the time at which the program starts.

    Attributes
    ----------
    start_s, end_s : float
    """

    def __init__(self, steps: Sequence[ProgramStep], start_s: float) -> None:
        times_s, places_mm = [start_s], [0.0]
        for step in steps:
            to_mm = places_mm[-1] if step.to_mm is None else step.to_mm
            duration_s = step.wait_s or abs(to_mm - places_mm[-1]) / (step.speed_mm_s or 1.0)
            times_s.append(times_s[-1] + duration_s)
            places_mm.append(to_mm)
        self.start_s, self.end_s = start_s, times_s[-1]
        self._times_s, self._places_mm = np.array(times_s), np.array(places_mm)
        self._furthest_mm = np.maximum.accumulate(self._places_mm)

    def running(self, time_s: float) -> bool:
        """Return whether the program runs at a time."""
        return self.start_s <= time_s < self.end_s

    def displacement_mm(self, time_s: float) -> float:
        """Return the position of the crosshead at a time. After the program the crosshead stands."""
        return float(np.interp(time_s, self._times_s, self._places_mm))

    def furthest_mm(self, time_s: float) -> float:
        """Return the furthest position that the crosshead has had until a time."""
        passed = int(np.searchsorted(self._times_s, time_s, side="right")) - 1
        return max(float(self._furthest_mm[max(passed, 0)]), self.displacement_mm(time_s))
