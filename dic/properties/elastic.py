"""The elastic slope of a test with its standard deviation, and the strain at which its line starts."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from dic.properties.objective_slope import RULE, objective_slope
from dic.properties.record import Record
from dic.properties.settings import PropertySettings
from dic.properties.value import NORMAL_95, PropertyValue, missing, root_sum
from dic.properties.windows import FittedLine, fit_line, std_of_slope
from dic.typing import Float

FIXED_RULE = "least squares between fixed stresses"
REMEDY = "record more points in the elastic part, or give --window-mpa"
LEAST_POINTS = 5
MOST_STD_SHARE = 0.1
"""A slope with a larger standard deviation is no elastic slope: the window contains yielding, or the noise is
as large as the strain."""
TOE_STRAIN = 5e-5
FEW_POINTS = 50
"""ISO 6892-1 asks for at least this many points in the window of an elastic slope."""


@dataclass(frozen=True)
class Elastic:
    """The elastic line of a test."""

    line: FittedLine
    """Stress in MPa against strain."""
    std_mpa: float
    """Standard deviation of the slope due to noise and the choice of the window, without errors that are
    common to all points.
    """
    centre: tuple[float, float]
    """Mean strain and mean stress of the window. Every least squares line passes through this point."""
    window: dict[str, Any]
    """Description of the window for JSON."""
    rule: str
    flags: tuple[str, ...]

    @property
    def foot(self) -> float:
        """Strain at which the elastic line has the stress 0; it is the corrected zero of the strain."""
        return -self.line.intercept / self.line.slope

    def turned(self, by_mpa: float) -> tuple[float, float]:
        """Return slope and foot of the line turned about `centre` so that its slope is larger by `by_mpa`."""
        slope = self.line.slope + by_mpa
        return slope, self.centre[0] - self.centre[1] / slope

    def value(self, settings: PropertySettings) -> PropertyValue:
        """Return the elastic modulus in GPa; its standard deviation includes errors common to all points."""
        slope = self.line.slope
        std = root_sum(self.std_mpa, slope * settings.stress_share, slope * settings.strain_share)
        return PropertyValue(slope / 1e3, std / 1e3, "GPa", self.rule, self.window, self.flags)


def elastic_line(
    record: Record, settings: PropertySettings, points: tuple[int, int] | None = None
) -> Elastic | PropertyValue:
    """Fit the elastic line of a test; if there is none, return a `PropertyValue` with the reason.

    If `points` is given, the line is fitted to the points from `points[0]` to before `points[1]`.
    """
    strain, stress = record.strain, record.strained_stress
    if points is not None:
        line = fit_line(strain, stress, *points)
        return _elastic(record, line, 0.0, RULE, {}, ())
    if settings.window_mpa is not None:
        return _in_fixed_window(record, settings.window_mpa)
    found = objective_slope(strain, stress)
    if isinstance(found, str):
        return missing("GPa", RULE, f"{found}; {REMEDY}")
    extra = {
        "range_share": found.range_share,
        "cut_mpa": float(stress[found.cut]),
        "cut_raised": found.raised,
    }
    elastic = _elastic(record, found.line, found.spread, RULE, extra, found.objections)
    share = elastic.std_mpa / elastic.line.slope
    if share > MOST_STD_SHARE:
        reason = f"the slope of the straightest window is known to {share:.0%} only"
        return missing("GPa", RULE, f"{reason}; {REMEDY}")
    return elastic


def _in_fixed_window(record: Record, window_mpa: tuple[float, float]) -> Elastic | PropertyValue:
    low, high = window_mpa
    stress = record.strained_stress
    first, stop = record.between(low, high)
    if stop - first < LEAST_POINTS:
        reason = f"few points: {stop - first} between {low:g} MPa and {high:g} MPa"
        return missing("GPa", FIXED_RULE, reason)
    if np.ptp(record.strain[first:stop]) == 0.0:
        return missing("GPa", FIXED_RULE, "the strain does not change within the window")
    line = fit_line(record.strain, stress, first, stop)
    if line.slope <= 0.0:
        return missing("GPa", FIXED_RULE, "the record does not rise within the window")
    middle = (first + stop) // 2
    halves = [fit_line(record.strain, stress, *part) for part in ((first, middle + 1), (middle - 1, stop))]
    # White noise makes the slopes of two halves differ by four standard deviations of the whole slope.
    spread = abs(halves[1].slope - halves[0].slope) / 4.0
    return _elastic(record, line, spread, FIXED_RULE, {}, _fixed_objections(line, halves))


def _fixed_objections(line: FittedLine, halves: list[FittedLine]) -> tuple[str, ...]:
    flags = []
    if line.residual > 5e-4:
        flags.append(f"curvature: R² is {1 - line.residual:.5f}, less than 0.9995")
    bend = (halves[1].slope - halves[0].slope) / line.slope
    if abs(bend) > 0.05:
        flags.append(f"curvature: the slopes of the window's halves differ by {bend:+.1%}")
    return tuple(flags)


def _elastic(
    record: Record,
    line: FittedLine,
    spread: float,
    rule: str,
    extra: dict[str, Any],
    objections: tuple[str, ...],
) -> Elastic:
    part = slice(line.first, line.stop)
    x, y = record.strain[part], record.strained_stress[part]
    noise, bias = _noise_of_slope(record, line, x, y)
    window = {
        "stress_mpa": [float(y.min()), float(y.max())],
        "strain_percent": [100 * float(x.min()), 100 * float(x.max())],
        "points": len(x),
        "first_point": line.first,
        "last_point": line.stop - 1,
        "normalised_residual": line.residual,
        **extra,
    }
    flags = (*objections, *_course_flags(record, line, len(x)))
    std = root_sum(noise, spread, bias)
    return Elastic(line, std, (float(x.mean()), float(y.mean())), window, rule, flags)


def _noise_of_slope(record: Record, line: FittedLine, x: Float, y: Float) -> tuple[float, float]:
    """Return a slope's standard deviation due to noise, and its decrease due to noise of the strain."""
    from scipy.special import stdtrit

    rest = y - line.slope * x - line.intercept
    across = float(((x - x.mean()) ** 2).sum())
    free = max(len(x) - 2, 1)
    std = std_of_slope(x, y, line)
    # Few points give an inaccurate scatter, so use the 95 % interval of Student's distribution.
    std *= float(stdtrit(free, 0.975)) / NORMAL_95
    # Points with correlated errors, as in a filtered signal, contain less information than independent ones.
    alike = float(np.clip((rest[1:] @ rest[:-1]) / max(float(rest @ rest), 1e-300), 0.0, 0.98))
    std *= np.sqrt((1.0 + alike) / (1.0 - alike))
    # The points of a short window may show less of the correlation than the whole record.
    parts = ((record.strained_stress, 1.0), (record.strain, line.slope))
    known = [(record.alike(values), factor * record.noise(values)) for values, factor in parts]
    least = root_sum(*(size * np.sqrt((1.0 + like) / (1.0 - like)) for like, size in known if like > 0.0))
    std = max(std, least / np.sqrt(across))
    return std, line.slope * record.noise(x) ** 2 * len(x) / across


def _course_flags(record: Record, line: FittedLine, points: int) -> list[str]:
    """Return flags for objections to the elastic slope: few points, a toe, hysteresis, or load in steps."""
    flags = []
    if points < FEW_POINTS:
        flags.append(f"few points: {points} in the window; ISO 6892-1 asks for {FEW_POINTS}")
    strain, stress = record.strain, record.strained_stress
    gap = float(strain[0] - (stress[0] - line.intercept) / line.slope)
    if abs(gap) > TOE_STRAIN + 5.0 * record.noise(strain):
        flags.append(f"toe: the record begins {abs(1e6 * gap):.0f} µε beside the elastic line")
    loops = record.loops(line.stop)
    if loops:
        high, low = loops[0]
        flags.append(f"hysteresis: unloaded {len(loops)} times, first from {high:.0f} to {low:.0f} MPa")
    if record.is_ladder(max(line.stop - 1, 1)):
        flags.append("ladder: the load rose in settled steps, not continuously as the rules assume")
    return flags
