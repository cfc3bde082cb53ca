"""Stress and strain of a test, and events in them: extensometer taken off, break, load steps, loops."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from dic.errors import CurveError
from dic.properties.curve import Curve
from dic.typing import Float

STILL_STRAIN, STILL_LOAD_SHARE, STILL_POINTS = 2e-5, 0.02, 20
"""The extensometer is off if the strain changes by at most `STILL_STRAIN` over at least `STILL_POINTS`
points, while the load changes by more than `STILL_LOAD_SHARE` of its largest value.
"""
JUMP_STRAIN, JUMP_TIMES, JUMP_LOAD_SHARE = 2e-3, 50.0, 0.05
"""A step of strain is the removal of the extensometer if it exceeds `JUMP_STRAIN` and `JUMP_TIMES` usual
steps, and the load changes by less than `JUMP_LOAD_SHARE` of its largest value.
"""
JUMP_NEAR = 5
"""The usual step is the median over this number of steps before or after the step that is checked."""
MARKER_EQUAL, MARKER_TIMES, MARKER_SHARE = 0.99, 3.0, 0.1
"""Loads of at least `MARKER_EQUAL` of the largest one are no loads if they exceed all others by
`MARKER_TIMES` and are at most this share of the points.
"""
FAR_TIMES, MOST_GROWTH, LEAST_GROWTH = 30, 2.0, 1.2
"""Noise is sought in differences of values whose distance is at most 1 / `FAR_TIMES` of the record. It may
grow by `MOST_GROWTH` when the distance doubles, and is that of neighbours unless it is larger by
`LEAST_GROWTH`.
"""
BROKEN_SHARE, LOOP_SHARE = 0.1, 0.02
LADDER_TIMES, LADDER_SHARE, LADDER_STEPS = 5.0, 0.7, 4


@dataclass(frozen=True)
class Record:
    """Stress and strain of a tensile test."""

    curve: Curve
    area_mm2: float
    stress: Float
    """Shape (n,). Load divided by the original area, MPa, at all points."""
    end: int
    """Number of points with a valid strain."""
    end_reason: str
    """Reason why the strain ends before the load; empty if it does not end earlier."""

    @property
    def strain(self) -> Float:
        """Valid strain, shape (end,)."""
        return self.curve.strain[: self.end]

    @property
    def strained_stress(self) -> Float:
        """Stress at the points with a valid strain, MPa, shape (end,)."""
        return self.stress[: self.end]

    def passed(self, first: int, stop: int) -> tuple[float, float]:
        """Return the smallest and the largest stress, MPa, of the images without strain between two points.

        An image whose gauge has no reading has a load but no strain. If there is no such image, the result is
        (inf, -inf).
        """
        passed = self.curve.passed_n
        if passed is None:
            return np.inf, -np.inf
        some = passed[first + 1 : stop] / self.area_mm2
        return float(np.nanmin(some[:, 0], initial=np.inf)), float(np.nanmax(some[:, 1], initial=-np.inf))

    @cached_property
    def top(self) -> int:
        """Index of the point with the largest load."""
        return int(np.argmax(self.stress))

    @cached_property
    def break_point(self) -> int | None:
        """Index of the last point before the specimen broke; None if the record does not show the break."""
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

    def between(self, low_mpa: float, high_mpa: float) -> tuple[int, int]:
        """Return the first point between two stresses during the first loading, and the point after the last.

        The window is empty if the stress never exceeds `high_mpa`.
        """
        stress = self.strained_stress
        stop = int(np.argmax(stress > high_mpa))
        below = np.flatnonzero(stress[:stop] < low_mpa)
        return int(below[-1]) + 1 if below.size else 0, stop

    def noise(self, values: Float) -> float:
        """Return a robust standard deviation of the noise of values, from third differences."""
        return self._noise(values)[0]

    def alike(self, values: Float) -> float:
        """Return the correlation of the noise of neighbouring values; 0 for white noise.

        The noise of the third differences of neighbours has the share 1 - 1.5 r + 0.6 r² - 0.1 r³ of the
        variance, if the noise is that of a filter of first order with the correlation r.
        """
        whole, near = self._noise(values)
        if whole <= near:
            return 0.0
        known = np.linspace(0.98, 0.0, 99)
        shares = 1.0 - 1.5 * known + 0.6 * known**2 - 0.1 * known**3
        return float(np.interp((near / whole) ** 2, shares, known))

    def _noise(self, values: Float) -> tuple[float, float]:
        """Return the noise of values, and what differences of neighbours show of it.

        Neighbouring values of a filtered or quickly sampled signal have nearly the same noise, which their
        differences do not show. So values farther apart are compared, as long as the differences grow as
        those of noise do: the differences of the curve itself grow by 8 when the distance doubles.
        """
        if len(values) < 8:
            return 0.0, 0.0
        seen = [_third_differences(values, 1)]
        apart = 2
        while FAR_TIMES * apart <= len(values):
            further = _third_differences(values, apart)
            if further > MOST_GROWTH * seen[-1]:
                break
            seen.append(further)
            apart *= 2
        # The last differences may contain the curve.
        whole = max(seen[:-1], default=seen[0])
        return (whole if whole > LEAST_GROWTH * seen[0] else seen[0]), seen[0]

    def stress_noise(self, stress: Float) -> float:
        """Return the standard deviation of the noise of stresses of the record, MPa.

        It is the noise that they show, or the stated one if this is larger: the noise of loads that share
        samples is alike at neighbouring points, so that their differences do not show it.
        """
        stated = self.curve.load_std_n
        known = np.zeros(0) if stated is None else stated[np.isfinite(stated)]
        least = float(np.median(known)) / self.area_mm2 if known.size else 0.0
        return max(self.noise(stress), least)

    def loops(self, stop: int) -> list[tuple[float, float]]:
        """Return the highest and lowest stress of each unloading-reloading loop before the point `stop`."""
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
        """Return True if the load up to the point `stop` rose in few large steps with rests between them."""
        steps = np.diff(self.stress[: stop + 1])
        if len(steps) < 3 * LADDER_STEPS:
            return False
        large = steps > LADDER_TIMES * max(float(np.median(np.abs(steps))), 1e-12)
        rise = float(self.stress[stop] - self.stress[0])
        enough = np.count_nonzero(large) >= LADDER_STEPS and np.count_nonzero(large) <= 0.4 * len(steps)
        return bool(enough and steps[large].sum() > LADDER_SHARE * rise)


def _third_differences(values: Float, apart: int) -> float:
    """Return the noise that the third differences of values at a distance show, as if it were white."""
    first, second, third, fourth = (values[k * apart : len(values) - (3 - k) * apart] for k in range(4))
    # The third difference of white noise has 1 + 9 + 9 + 1 = 20 times its variance.
    return float(1.4826 * np.median(np.abs(fourth - first + 3.0 * (second - third))) / np.sqrt(20.0))


def record_of(curve: Curve, area_mm2: float) -> Record:
    """Compute the stress of a test, and find up to which point its strain is valid.

    Raises `CurveError` if the strain does not change, or a single load is no load.
    """
    _require_strain(curve)
    _require_no_marker(curve)
    end, reason = _valid_strain(curve)
    return Record(curve, area_mm2, curve.load_n / area_mm2, end, reason)


def _require_strain(curve: Curve) -> None:
    """Raise an error if all strains are equal but for noise, such as in a wrong unit."""
    spread = float(np.nanmax(curve.strain) - np.nanmin(curve.strain))
    if spread <= STILL_STRAIN:
        expected = f"strains that change by more than {1e6 * STILL_STRAIN:g} µε"
        remedy = "check the column and the unit of the strain"
        raise CurveError(curve.source, "strain", expected, f"{1e6 * spread:.3g} µε in all", remedy)


def _require_no_marker(curve: Curve) -> None:
    """Raise an error if a few loads are far above all others, such as 99999 where no load was measured."""
    most = float(curve.load_n.max())
    marked = curve.load_n >= MARKER_EQUAL * most
    others = curve.load_n[~marked]
    beside = np.convolve(marked, [1, 0, 1], "same") > 0
    if np.count_nonzero(marked) > MARKER_SHARE * len(marked) or not others.size:
        return
    if most > MARKER_TIMES * max(float(others.max()), 0.0) and not (marked & beside).all():
        expected = f"loads near the others, of at most {others.max():.6g} N"
        got = f"{most:.6g} N at point {int(np.argmax(curve.load_n)) + 1}"
        remedy = "delete the lines without a measured load"
        raise CurveError(curve.source, "load", expected, got, remedy)


def _valid_strain(curve: Curve) -> tuple[int, str]:
    """Return the number of points with a valid strain, and the reason if not all points have one."""
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
    """Return the points after which the strain jumps because the extensometer was removed.

    Such a step is far larger than the usual steps before and after it. Images at equal times or loads also
    have large steps of strain in the plastic part, but in this part the neighbouring steps are equally large.
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
    # An extensometer is taken off once, so several large steps forwards belong to the test itself.
    return found[:0] if len(found) > 2 and (steps[found] > 0.0).all() else found


def _standing_from(strain: Float) -> int:
    """Return the first point after which the strain varies by at most `STILL_STRAIN` until the end."""
    back = strain[::-1]
    spread = np.maximum.accumulate(back) - np.minimum.accumulate(back)
    moving = np.flatnonzero(spread > STILL_STRAIN)
    return len(strain) - int(moving[0]) if moving.size else 0
