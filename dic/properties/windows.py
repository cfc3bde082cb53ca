"""Least squares lines in every window of consecutive points, computed from running sums."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dic.typing import Float

_TIE = 1e-10
"""Windows whose normalised residuals differ by less are fitted again, because running sums lose digits."""
_MOST_REFITTED = 500
_MOST_IN_RUNS = 100
"""Records with more points are averaged over blocks before `steepest_run` compares their runs."""


@dataclass(frozen=True)
class FittedLine:
    """A least squares line through the points from `first` to before `stop`."""

    first: int
    stop: int
    slope: float
    intercept: float
    """Slope and intercept of y against x."""
    residual: float
    """Sum of squared residuals divided by the sum of squared deviations of y from its mean."""


def fit_line(x: Float, y: Float, first: int, stop: int) -> FittedLine:
    """Fit a line to the points from `first` to before `stop`; x must not be constant there."""
    x_part, y_part = x[first:stop], y[first:stop]
    x_mean, y_mean = float(x_part.mean()), float(y_part.mean())
    dx, dy = x_part - x_mean, y_part - y_mean
    slope = float(dx @ dy / (dx @ dx))
    spread = float(dy @ dy)
    rest = dy - slope * dx
    residual = float(rest @ rest) / spread if spread > 0.0 else 1.0
    return FittedLine(first, stop, slope, y_mean - slope * x_mean, residual)


def std_of_slope(x: Float, y: Float, line: FittedLine) -> float:
    """Return the standard deviation of a line's slope, from the scatter of the points (n,) about the line."""
    rest = y - line.slope * x - line.intercept
    across = float(((x - x.mean()) ** 2).sum())
    return float(np.sqrt(rest @ rest / max(len(x) - 2, 1) / across))


def straightest(x: Float, y: Float, least: int) -> FittedLine | None:
    """Return the line of the window with the least normalised residual.

    `x`, `y`, shape (n,): normalised record: both axes from 0 to about 1. `least`: smallest number of points
    of a window.

    If several windows are equally good, the result is the one that begins first, and of these the longest.
    None if x or y does not change in any window.
    """
    candidates: list[tuple[float, int, int]] = []
    bound = np.inf
    for first, residual, _ in _all_windows(x, y, least):
        bound = min(bound, float(residual.min()))
        near = np.flatnonzero(residual <= bound + _TIE)
        # If running sums cannot tell windows apart, keep those with the least residual and the longest one.
        best = near[np.argsort(residual[near], kind="stable")[:4]]
        keep = {*(int(k) for k in best), *((int(near[-1]),) if near.size else ())}
        candidates += [(float(residual[k]), first, first + least + k) for k in sorted(keep)]
    if not np.isfinite(bound):
        return None
    candidates = sorted(each for each in candidates if each[0] <= bound + _TIE)[:_MOST_REFITTED]
    lines = [fit_line(x, y, first, stop) for _, first, stop in candidates]
    return min(lines, key=lambda line: (line.residual, line.first, -line.stop))


def spread_of_slopes(
    x: Float, y: Float, line: FittedLine, least: int, factor: float, later_slope: float
) -> float:
    """Return the root mean square difference from a line's slope over all windows that are nearly as good.

    `line`: the straightest line. `least`: smallest number of points of a window. `factor`: a window is nearly
    as good if its normalised residual is at most this multiple of the least one. `later_slope`: windows that
    begin later than the line and are less steep than this slope are no choice. `x` and `y` have the shape
    (n,).
    """
    total, count = 0.0, 0
    bound = factor * line.residual + _TIE
    for first, residual, slope in _all_windows(x, y, least):
        near = residual <= bound
        if first > line.first:
            near &= slope >= later_slope
        total += float(((slope[near] - line.slope) ** 2).sum())
        count += int(np.count_nonzero(near))
    return float(np.sqrt(total / count)) if count else 0.0


def steepest_run(x: Float, y: Float, least_range: float, margin_x: float) -> FittedLine | None:
    """Return the run of points with the least slope of x against y; an error of x is allowed for.

    `least_range`: a run must cover at least this range of y from its first to its last point. `margin_x`:
    error of x that is allowed for. The slope of x against y is increased by the effect of this error. `x` and
    `y` have the shape (n,).

    Result: the line of x against y, with the slope that allows for the error; None if no run is long enough.
    """
    width = -(-len(x) // _MOST_IN_RUNS)
    x, y = (part[: len(x) // width * width].reshape(-1, width).mean(axis=1) for part in (x, y))
    best: FittedLine | None = None
    for first in range(len(x) - 1):
        dx, dy = x[first:] - x[first], y[first:] - y[first]
        count = np.arange(1, len(dx) + 1)
        v_yy = np.cumsum(dy * dy) - np.cumsum(dy) ** 2 / count
        v_xy = np.cumsum(dx * dy) - np.cumsum(dx) * np.cumsum(dy) / count
        stops = np.flatnonzero((dy >= least_range) & (dy > 0.0))
        if not stops.size:
            continue
        slopes = v_xy[stops] / v_yy[stops] + margin_x / np.sqrt(v_yy[stops])
        k = int(np.argmin(slopes))
        if best is None or slopes[k] < best.slope:
            stop = first + int(stops[k]) + 1
            best = FittedLine(first * width, stop * width, float(slopes[k]), float("nan"), float("nan"))
    return best


def _all_windows(x: Float, y: Float, least: int) -> Iterator[tuple[int, Float, Float]]:
    """For each first point, yield residuals and slopes of all windows with enough points that begin there."""
    dx, dy = x - x.mean(), y - y.mean()
    sums = [np.concatenate([[0.0], np.cumsum(part)]) for part in (dx, dy, dx * dx, dx * dy, dy * dy)]
    for first in range(len(x) - least + 1):
        count = np.arange(least, len(x) - first + 1)
        s_x, s_y, s_xx, s_xy, s_yy = (part[first + least :] - part[first] for part in sums)
        v_xx, v_xy, v_yy = s_xx - s_x**2 / count, s_xy - s_x * s_y / count, s_yy - s_y**2 / count
        changes = (v_xx > 1e-14 * count) & (v_yy > 1e-14 * count)
        with np.errstate(divide="ignore", invalid="ignore"):
            residual = np.where(changes, 1.0 - v_xy**2 / (v_xx * v_yy), np.inf)
            slope = np.where(changes, v_xy / v_xx, 0.0)
        yield first, residual, slope
