"""Compare the travel of a crosshead with the speeds that its load frame has confirmed.

A load frame may confirm a change of speed, and report the new speed, while its crosshead keeps the old one.
Only the displacement shows this.
"""

import math
from collections import deque

SETTLING_S = 1.0
"""Longest time, in s, in which the crosshead may still have the speed before a change."""
SHARE = 0.1
"""Largest relative difference between the travel and the confirmed speed times the time."""
READING_MM = 0.005
"""Largest error of the difference of two readings of the displacement."""
SAMPLE_AGE_S = 0.05
"""Longest time, in s, from a sample in the machine to the request that reads it."""
_ENOUGH = 20.0
"""A comparison begins anew after a travel of this number of times the uncertainty of the readings."""


class Travel:
    """Bounds of the travel since a reading during a motion to a displacement, from its confirmed speeds.

    Nothing is compared before the first change of speed. The two times of each call tell when something
    happened: between the time before the request and the time after its answer, in s on the rig's clock.
    """

    def __init__(self) -> None:
        self.end()

    def end(self) -> None:
        """Compare nothing until another motion begins."""
        self._target_mm = math.nan
        self._compares = False
        self._former: deque[tuple[float, float]] = deque()

    @property
    def begun(self) -> bool:
        """True if a motion was begun and no end was noticed yet."""
        return not math.isnan(self._target_mm)

    def begin(self, target_mm: float, speed_mm_s: float) -> None:
        """Begin a motion to a target."""
        self.end()
        self._target_mm, self._speed_mm_s = target_mm, speed_mm_s

    def change(self, speed_mm_s: float, displacement_mm: float, asked_s: float, answered_s: float) -> None:
        """Note a confirmed change of speed, and the displacement that was read after it."""
        if not self._compares:
            self._compares = True
            self._restart(displacement_mm, asked_s, answered_s)
        self._pass(asked_s)
        self._former.append((answered_s + SETTLING_S, self._speed_mm_s))
        self._speed_mm_s = speed_mm_s

    def check(self, displacement_mm: float, asked_s: float, answered_s: float) -> None:
        """Compare the displacement of a reading. Raise `ValueError` if the crosshead travels otherwise."""
        if not self._compares:
            return
        self._pass(answered_s)
        way_mm = math.copysign(1.0, self._target_mm - self._from_mm) * (displacement_mm - self._from_mm)
        uncertain_s = self._uncertain_s + answered_s - asked_s + SAMPLE_AGE_S
        uncertain_mm = uncertain_s * self._fastest_mm_s + READING_MM
        # the crosshead brakes before its target
        brakes_mm = abs(self._target_mm - self._from_mm) - SETTLING_S * self._fastest_mm_s
        least_mm = (1.0 - SHARE) * min(self._least_mm, max(0.0, brakes_mm)) - uncertain_mm
        most_mm = (1.0 + SHARE) * self._most_mm + uncertain_mm
        if not least_mm <= way_mm <= most_mm:
            duration_s = answered_s - self._since_s
            raise ValueError(
                f"{way_mm:.4g} mm in {duration_s:.3g} s, not {max(0.0, least_mm):.4g} to {most_mm:.4g} mm"
            )
        if self._least_mm >= _ENOUGH * uncertain_mm:
            self._restart(displacement_mm, asked_s, answered_s)

    def _restart(self, displacement_mm: float, asked_s: float, answered_s: float) -> None:
        self._from_mm, self._since_s = displacement_mm, answered_s
        self._uncertain_s = answered_s - asked_s + SAMPLE_AGE_S
        self._now_s = answered_s
        self._least_mm = self._most_mm = 0.0
        self._fastest_mm_s = max(self._speed_mm_s, *(speed for _, speed in self._former), 0.0)

    def _pass(self, now_s: float) -> None:
        """Add the travel up to now. After a change, the speed may still be the former one for a while."""
        while self._former and self._former[0][0] <= now_s:
            self._add(self._former[0][0])
            self._former.popleft()
        self._add(now_s)

    def _add(self, until_s: float) -> None:
        speeds = [self._speed_mm_s, *(speed for _, speed in self._former)]
        duration_s = max(0.0, until_s - self._now_s)
        self._least_mm += duration_s * min(speeds)
        self._most_mm += duration_s * max(speeds)
        self._fastest_mm_s = max(self._fastest_mm_s, *speeds)
        self._now_s = max(self._now_s, until_s)
