"""Stress and strain of a test, and its events: extensometer taken off, break, steps, loops."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from dic.properties.curve import Curve
from dic.typing import Float

STILL_STRAIN, STILL_LOAD_SHARE, STILL_POINTS = 2e-5, 0.02, 20
"""Strain stands still if it changes by less than the first over so many points, while the load changes by
more than the second."""
JUMP_STRAIN, JUMP_TIMES, JUMP_LOAD_SHARE = 2e-3, 50.0, 0.05
"""A step of strain above the first, and above so many usual steps, with a smaller step of load than the
third, is the removal of the extensometer."""
JUMP_NEAR = 5
"""The usual step before or after a step is the median of so many steps."""
BROKEN_SHARE, LOOP_SHARE = 0.1, 0.02
LADDER_TIMES, LADDER_SHARE, LADDER_STEPS = 5.0, 0.7, 4


@dataclass(frozen=True)
class Record:
    """A tensile test in stress and strain.

    Attributes
    ----------
    curve : Curve
    area_mm2 : float
    stress : ndarray, shape (n,)
        Load over the original area, MPa, of all points.
    end : int
        Number of points with a valid strain.
    end_reason : str
        Why the strain ends before the load; empty if it does not.
    """

    curve: Curve
    area_mm2: float
    stress: Float
    end: int
    end_reason: str

    @property
    def strain(self) -> Float:
        """Valid strain, shape (end,)."""
        return self.curve.strain[: self.end]

    @property
    def strained_stress(self) -> Float:
        """Stress at the points with a valid strain, MPa, shape (end,)."""
        return self.stress[: self.end]

    def passed(self, first: int, stop: int) -> tuple[float, float]:
        """Return the smallest and the largest stress without strain between two points, MPa.

        Images without a reading have a load and no strain. Without any, the result is (inf, -inf).
        """
        passed = self.curve.passed_n
        if passed is None:
            return np.inf, -np.inf
        some = passed[first + 1 : stop] / self.area_mm2
        return float(np.nanmin(some[:, 0], initial=np.inf)), float(np.nanmax(some[:, 1], initial=-np.inf))

    @cached_property
    def top(self) -> int:
        """Point of the largest load."""
        return int(np.argmax(self.stress))

    @cached_property
    def break_point(self) -> int | None:
        """Last point before the specimen broke; None if the record does not show the break."""
        after = self.stress[self.top :]
        low = np.flatnonzero(after < BROKEN_SHARE * self.stress[self.top])
        stop = int(low[0]) if low.size else len(after) - 1
        falls = -np.diff(after[: stop + 1])
        if falls.size < 2:
            return None
        usual = float(np.median(np.abs(np.diff(self.stress))))
        k = stop
        while k > 0 and falls[k - 1] > max(20.0 * usual, 0.002 * self.stress[self.top]):
            k -= 1
        return self.top + k if k < stop else None

    def noise(self, values: Float) -> float:
        """Return the standard deviation of white noise, robustly, from third differences."""
        if len(values) < 8:
            return 0.0
        # The third difference of white noise has 1 + 9 + 9 + 1 = 20 times its variance.
        return float(1.4826 * np.median(np.abs(np.diff(values, n=3))) / np.sqrt(20.0))

    def loops(self, stop: int) -> list[tuple[float, float]]:
        """Return the highest and the lowest stress of each loop of unloading and loading before a point."""
        stress, strain = self.stress[:stop], self.strain[:stop]
        least = LOOP_SHARE * float(self.stress[self.top])
        found: list[tuple[float, float]] = []
        peak, valley = 0, 0
        for k in range(1, len(stress)):
            if stress[k] < stress[valley]:
                valley = k
            unloaded = stress[peak] - stress[valley] > least and strain[peak] - strain[valley] > 0.0
            if stress[k] >= stress[peak]:
                if unloaded:
                    found.append((float(stress[peak]), float(stress[valley])))
                peak = valley = k
        return found

    def is_ladder(self, stop: int) -> bool:
        """Return True if the load rose in few large steps with rests between them, up to a point."""
        steps = np.diff(self.stress[: stop + 1])
        if len(steps) < 3 * LADDER_STEPS:
            return False
        large = steps > LADDER_TIMES * max(float(np.median(np.abs(steps))), 1e-12)
        rise = float(self.stress[stop] - self.stress[0])
        enough = np.count_nonzero(large) >= LADDER_STEPS and np.count_nonzero(large) <= 0.4 * len(steps)
        return bool(enough and steps[large].sum() > LADDER_SHARE * rise)


def record_of(curve: Curve, area_mm2: float) -> Record:
    """Return stress and valid strain of a test."""
    end, reason = _valid_strain(curve)
    return Record(curve, area_mm2, curve.load_n / area_mm2, end, reason)


def _valid_strain(curve: Curve) -> tuple[int, str]:
    """Return how many points have a valid strain, and why not all have."""
    end, reason = curve.measured, ""
    if end < len(curve.strain):
        reason = "extensometer: the strain ends before the load"
    strain, load = curve.strain[:end], curve.load_n[:end]
    most = float(curve.load_n.max())
    still = _standing_from(strain)
    broken = np.flatnonzero(load[int(np.argmax(load)) :] < BROKEN_SHARE * most)
    stop = int(np.argmax(load)) + int(broken[0]) if broken.size else end
    moved = float(np.ptp(load[still:stop])) if still < stop else 0.0
    if stop - still >= STILL_POINTS and moved > STILL_LOAD_SHARE * most:
        end, reason = still + 1, "extensometer: the strain stands still while the load goes on"
    jumps = _jumps(strain[:end], load[:end], most)
    steps = np.abs(np.diff(strain[:end]))
    if jumps.size and jumps[0] + 1 >= 10:
        end = int(jumps[0]) + 1
        reason = f"extensometer: the strain jumps by {100 * steps[jumps[0]]:.2f} % while the load does not"
    return end, reason


def _jumps(strain: Float, load: Float, most: float) -> np.ndarray:
    """Return the points before which nothing but the removal of the extensometer explains a step of strain.

    Such a step is far above the usual step before it and after it. Images taken at equal times or loads have
    much larger steps in the plastic part than in the elastic part, but there every step is large.
    """
    steps = np.diff(strain)
    around = np.pad(np.abs(steps), JUMP_NEAR, constant_values=np.nan)
    windows = sliding_window_view(around, 2 * JUMP_NEAR + 1)
    usual = np.zeros(len(steps))
    for side in (windows[:, :JUMP_NEAR], windows[:, JUMP_NEAR + 1 :]):
        known = np.isfinite(side).any(axis=1)
        usual[known] = np.maximum(usual[known], np.nanmedian(side[known], axis=1))
    quiet = np.abs(np.diff(load)) < JUMP_LOAD_SHARE * most
    found = np.flatnonzero((np.abs(steps) > np.maximum(JUMP_STRAIN, JUMP_TIMES * usual)) & quiet)
    # An extensometer is taken off once. Several large steps forwards are the steps of the test itself.
    return found[:0] if len(found) > 2 and (steps[found] > 0.0).all() else found


def _standing_from(strain: Float) -> int:
    """Return the first point from which on the strain stays within `STILL_STRAIN`."""
    back = strain[::-1]
    spread = np.maximum.accumulate(back) - np.minimum.accumulate(back)
    moving = np.flatnonzero(spread > STILL_STRAIN)
    return len(strain) - int(moving[0]) if moving.size else 0
