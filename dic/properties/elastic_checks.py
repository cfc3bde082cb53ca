"""Checks that a window is the elastic part of a record, also if this part has few points.

ASTM E3076 compares the slopes of the first and the last quarter of a window, which needs five points in each
quarter. A record of settled load steps has fewer points. A window of ten points may then contain yielding, or
lie in the hardening. The checks of this module find such windows. They allow for the scatter of the points.
"""

import numpy as np

from dic.properties.windows import FittedLine, fit_line, steepest_run
from dic.typing import Float

ENOUGH_POINTS = 20
"""A window with at least this number of points has five points in each quarter."""
STEEPER, STEEPER_OF_FEW, RUN_SHARE, RUN_STDS = 2.0, 1.25, 0.5, 4.0
"""Any run of points that covers `RUN_SHARE` of the window's range of stress must be less than `STEEPER` times
as steep as the window, or `STEEPER_OF_FEW` times in a window with few points. An error of the strain of
`RUN_STDS` standard deviations is allowed for.
"""
BEND_LIMIT, BEND_STDS = 0.05, 2.0
"""Largest relative difference between the slope at the middle of an end quarter and the slope of the whole
window; `BEND_STDS` standard deviations are allowed for.
"""
LAST_POINTS, LAST_LIMIT, LAST_STDS = 2, 0.01, 3.0
"""The last one or two points show yielding if the slope without them is larger by more than `LAST_LIMIT`, and
their strain is too large by more than `LAST_STDS` standard deviations.
"""


def not_elastic(x: Float, y: Float, line: FittedLine) -> str | None:
    """Return the reason why a window is not the elastic part of the record; None if it may be this part.

    `x`, `y`, shape (n,): strain and stress, or both scaled to one, from the beginning of the record to beyond
    the window. `line`: the fit of stress against strain in the window.
    """
    if line.slope <= 0.0:
        return "the straightest window does not rise"
    part = slice(line.first, line.stop)
    rest = x[part] - (y[part] - line.intercept) / line.slope
    std_x = float(np.sqrt(rest @ rest / max(len(rest) - 2, 1)))
    least_range = RUN_SHARE * float(np.ptp(y[part]))
    run = steepest_run(x, y, least_range, RUN_STDS * std_x)
    steeper = STEEPER if len(rest) >= ENOUGH_POINTS else STEEPER_OF_FEW
    if run is not None and run.slope * line.slope < 1.0 / steeper:
        return (
            f"few points in the elastic part: {run.stop - run.first} points are steeper than the straightest"
            f" window of {line.stop - line.first} points"
        )
    if len(rest) >= ENOUGH_POINTS:
        return None
    if _bend(x[part], y[part]) > BEND_LIMIT or _end_yields(x, y, line):
        return f"few points in the elastic part: the straightest window of {len(rest)} points is curved"
    return None


def _end_yields(x: Float, y: Float, line: FittedLine) -> bool:
    """Return True if the last points of a window have too much strain for the line of its other points."""
    for count in range(1, LAST_POINTS + 1):
        stop = line.stop - count
        u, v = x[line.first : stop], y[line.first : stop]
        others = fit_line(v, u, 0, len(v))
        across = float(((v - v.mean()) ** 2).sum())
        rest = u - others.slope * v - others.intercept
        end_x, end_y = float(x[stop : line.stop].mean()), float(y[stop : line.stop].mean())
        excess = end_x - others.slope * end_y - others.intercept
        spread = 1.0 / count + 1.0 / len(v) + (end_y - float(v.mean())) ** 2 / across
        std = float(np.sqrt(rest @ rest / (len(v) - 2) * spread))
        if excess > LAST_STDS * std and 1.0 / (others.slope * line.slope) > 1.0 + LAST_LIMIT:
            return True
    return False


def _bend(x: Float, y: Float) -> float:
    """Return the relative difference of the slope at an end of a window, less what scatter explains.

    A parabola is fitted to strain against stress. Its slope at the middle of the end quarter is compared with
    its slope at the middle of the window.
    """
    v = (y - y.mean()) / (0.5 * np.ptp(y))
    design = np.column_stack([np.ones(len(v)), v, v**2])
    found = np.linalg.lstsq(design, x, rcond=None)[0]
    rest = x - design @ found
    variance = float(rest @ rest) / max(len(v) - 3, 1) * float(np.linalg.inv(design.T @ design)[2, 2])
    # At three quarters of the way from the middle to an end, the parabola's slope differs by 2 · 0.75 · c.
    return float(1.5 * (abs(found[2]) - BEND_STDS * np.sqrt(variance)) / abs(found[1]))
