"""The slope of a test record's linear part without an operator's choice, after the rule of ASTM E3076-18.

The rule is described by E. Lucon, NIST Technical Note 2050 (2019), and by S. Graham and M. Adler, Journal of
Testing and Evaluation 39 (2011): slope determination by the analysis of residuals.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from dic.properties.elastic_checks import not_elastic
from dic.properties.windows import FittedLine, fit_line, spread_of_slopes, straightest
from dic.typing import Float

RULE = "objective window, rule of ASTM E3076-18"
TOO_FEW = "few points: no window of ten points in the rising part of the record"
FIRST_SHARE, CUT_SHARE, RAISED_SHARE = 0.05, 0.15, 0.05
"""Shares of the largest stress. The tangent line starts at the first point whose stress exceeds
`FIRST_SHARE`. The stress of the start is then raised by `CUT_SHARE`, and at each further attempt by
`RAISED_SHARE`.
"""
LEAST_SHARE, LEAST_POINTS = 0.2, 10
"""A window has at least this share of the points up to the cut, and at least this number of points."""
NOISE_LIMIT, RESOLUTION, RESOLUTION_BINS, BIN_SHARE = 0.005, 2.0**-12, 3, 0.25
QUARTER_LIMIT, QUARTER_POINTS, RANGE_LIMIT = 0.05, 5, 0.4
STEEP_SHARE = 0.5
"""A slope below this share of the steepest slope of all attempts is not an elastic slope."""
NEARLY_AS_GOOD = 2.0
"""A window is nearly as good as the best one if its residual is at most this multiple of the least residual.
The scatter of the slopes of such windows is the standard deviation due to the choice of the window.
"""
MOST_POINTS = 1500
"""Longer records are averaged over blocks of consecutive points before the windows are compared."""


@dataclass(frozen=True)
class ObjectiveSlope:
    """The slope of the straightest window of a record, and the checks that it failed."""

    line: FittedLine
    """Fit to all points of the window, in the record's units."""
    cut: int
    """Index of the point at which the record was cut."""
    raised: int
    """How often the start of the tangent line was raised to find the cut."""
    range_share: float
    """Range of y in the window, divided by the range of y up to the cut."""
    spread: float
    """Standard deviation of the slope due to the choice of the window."""
    objections: tuple[str, ...]
    """Checks of the rule that failed; empty if the rule accepts the slope."""


def objective_slope(x: Float, y: Float) -> ObjectiveSlope | str:
    """Find the slope of the linear part at the beginning of a record.

    `x`, `y`, shape (n,): strain and stress, in the order of the test, without gaps.

    Result: the first accepted slope. If no slope is accepted, the first slope with the fewest objections. An
    objection to the range counts least, because a short window may still be straight. A window that is not
    the elastic part is never used. If no window gives a slope, the reason is returned.
    """
    shifted_x, shifted_y = x - x[0], y - y[0]
    largest = float(shifted_y.max())
    if largest <= 0.0:
        return "the record does not rise"
    start = int(np.argmax(shifted_y > FIRST_SHARE * largest))
    attempts: dict[int, ObjectiveSlope | str] = {}
    raised = 0
    while (cut := _tangency(shifted_x, shifted_y, start, raised)) is not None:
        if cut not in attempts:
            found = attempts[cut] = _at_cut(x, y, cut, raised)
            accepted = isinstance(found, ObjectiveSlope) and not found.objections
            if accepted and found in (steep := _steep(attempts.values())):
                return _with_spread(x, y, steep[steep.index(found)])
        raised += 1
    steep = _steep(attempts.values())
    if not steep:
        reasons = [each for each in attempts.values() if isinstance(each, str) and each != TOO_FEW]
        return reasons[0] if reasons else TOO_FEW
    return _with_spread(x, y, min(steep, key=_doubts))


def _doubts(found: ObjectiveSlope) -> tuple[int, int]:
    others = [each for each in found.objections if not each.startswith("range:")]
    return len(others), len(found.objections)


def _steep(attempts: Iterable[ObjectiveSlope | str]) -> list[ObjectiveSlope]:
    """Leave out slopes far below the steepest: their windows lie in the hardening, beyond the linear part."""
    found = [each for each in attempts if isinstance(each, ObjectiveSlope)]
    steepest = max((each.line.slope for each in found), default=0.0)
    return [each for each in found if each.line.slope >= STEEP_SHARE * steepest]


def _tangency(x: Float, y: Float, start: int, raised: int) -> int | None:
    """Return the point to which the line from the raised start is steepest; None if no point is above it."""
    largest = float(y.max())
    base = y[start] + (CUT_SHARE + RAISED_SHARE * raised) * largest
    later = start + 1 + np.flatnonzero((y[start + 1 :] > base) & (x[start + 1 :] > x[start]))
    if not later.size:
        return None
    return int(later[np.argmax((y[later] - base) / (x[later] - x[start]))])


def _at_cut(x: Float, y: Float, cut: int, raised: int) -> ObjectiveSlope | str:
    """Fit a line in every window of the record up to the cut, and check the straightest window."""
    if x[cut] <= x[0] or y[cut] <= y[0]:
        return TOO_FEW
    u, v, width = _normalised(x, y, cut)
    least = max(int(LEAST_SHARE * len(u)), LEAST_POINTS)
    line = straightest(u, v, least) if len(u) >= least else None
    if line is None:
        return TOO_FEW
    if (reason := not_elastic(u, v, line)) is not None:
        return reason
    part = slice(line.first, line.stop)
    range_share = float(np.ptp(v[part]))
    return ObjectiveSlope(
        line=fit_line(x, y, line.first * width, line.stop * width),
        cut=cut,
        raised=raised,
        range_share=range_share,
        spread=0.0,
        objections=(*_data_objections(u, v), *_fit_objections(u, v, line, range_share)),
    )


def _with_spread(x: Float, y: Float, found: ObjectiveSlope) -> ObjectiveSlope:
    """Return the slope with the standard deviation due to the choice of the window."""
    u, v, width = _normalised(x, y, found.cut)
    least = max(int(LEAST_SHARE * len(u)), LEAST_POINTS)
    line = fit_line(u, v, found.line.first // width, found.line.stop // width)
    scale = float((y[found.cut] - y[0]) / (x[found.cut] - x[0]))
    # A straight part of the hardening after the line is no other choice of the elastic part.
    hardening = STEEP_SHARE * line.slope
    return replace(found, spread=scale * spread_of_slopes(u, v, line, least, NEARLY_AS_GOOD, hardening))


def _normalised(x: Float, y: Float, cut: int) -> tuple[Float, Float, int]:
    """Return the record up to the cut, scaled to 0 to 1, and the number of points averaged into one."""
    width = -(-(cut + 1) // MOST_POINTS)
    mean_x, mean_y = (_block_means(part[: cut + 1], width) for part in (x, y))
    return (mean_x - x[0]) / (x[cut] - x[0]), (mean_y - y[0]) / (y[cut] - y[0]), width


def _block_means(values: Float, width: int) -> Float:
    whole = len(values) // width * width
    return np.asarray(values[:whole].reshape(-1, width).mean(axis=1))


def _data_objections(u: Float, v: Float) -> list[str]:
    """Return the objections to the noise and the digital resolution of the normalised record."""
    objections = []
    for name, values in (("strain", u), ("stress", v)):
        step = np.diff(values)
        if (noise := float(np.std(step, ddof=1))) > NOISE_LIMIT:
            objections.append(f"noise: {name} steps scatter by {noise:.2%} of its range, more than 0.5 %")
        bins = np.rint(np.abs(np.diff(step)) / RESOLUTION).astype(np.int64)
        count = np.bincount(np.minimum(bins, 4096), minlength=2)
        commonest = int(np.argmax(count[1:])) + 1
        coarse = max(count[0], count[commonest]) > BIN_SHARE * len(bins)
        if commonest > RESOLUTION_BINS and coarse:
            objections.append(f"resolution: {name} changes in steps of {commonest / 4096:.2%} of its range")
    return objections


def _fit_objections(u: Float, v: Float, line: FittedLine, range_share: float) -> list[str]:
    """Return the objections to a fit: curvature at one of its ends, or too small a range of stress."""
    objections = []
    x, rest = u[line.first : line.stop], v[line.first : line.stop]
    rest = rest - line.slope * x - line.intercept
    low, high = float(x.min()), float(x.max())
    for name, part in (
        ("first", x <= low + 0.25 * (high - low)),
        ("last", x >= high - 0.25 * (high - low)),
    ):
        if np.count_nonzero(part) < QUARTER_POINTS:
            objections.append(f"few points: the {name} quarter of the fit has fewer than {QUARTER_POINTS}")
            continue
        across = x[part] - x[part].mean()
        bend = float(across @ rest[part] / (across @ across)) / line.slope
        if abs(bend) > QUARTER_LIMIT:
            objections.append(f"curvature: the slope of the fit's {name} quarter differs by {bend:+.1%}")
    if line.stop == len(u):
        objections.append("cut: the fit ends where the record was cut")
    if range_share < RANGE_LIMIT:
        objections.append(f"range: the fit covers {range_share:.0%} of the stress up to the cut, not 40 %")
    return objections
