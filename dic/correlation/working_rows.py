"""The rows of large images that the kernel needs for some points, in the reference and after the motion."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from dic.correlation import kernel
from dic.typing import Float, Indices

Rows = tuple[int, int]
"""The first row, and the row after the last one. They may lie outside the image."""

_STRIP_PX = 64
"""Points that are solved one by one are solved together if they lie within this number of rows."""

_MARGIN_PX = kernel.ROOM_PX + 8
"""Rows around the expected subsets: the room for iterations, and the pixels that interpolation needs."""

_SAMPLE = 2000
"""Number of converged points from which the motion of a band is estimated."""


class PointStrip(NamedTuple):
    """Points that are solved with the same rows of both images."""

    members: Indices
    """Shape (n,). Indices of the points."""
    here: Rows
    there: Rows
    """Rows of the reference and of the deformed image that the subsets need."""


def strips(points: Indices, warps: Float, radius: int, *, whole: bool) -> Iterator[PointStrip]:
    """Divide points into strips of rows.

    `points`, shape (n, 2): coordinates (x, y) of the points. `warps`, shape (n, 6 or 12): first guesses.
    `radius`: number of pixels of a subset on either side of its point. `whole`: True if the images are laid
    as a whole. All points are then in one strip, in their order.
    """
    if not len(points):
        return
    if whole:
        yield PointStrip(np.arange(len(points)), (0, 0), (0, 0))
        return
    order = np.argsort(points[:, 1], kind="stable")
    y = points[order, 1]
    first = 0
    while first < len(order):
        last = int(np.searchsorted(y, y[first] + _STRIP_PX, side="right"))
        members = order[first:last]
        here = int(y[first]) - radius, int(y[last - 1]) + radius + 1
        yield PointStrip(members, here, _rows_of_guesses(points[members, 1], warps[members], radius))
        first = last


def _rows_of_guesses(y: Indices, warps: Float, radius: int) -> Rows:
    reach = radius * (np.abs(warps[:, 4]) + np.abs(1.0 + warps[:, 5])) + _MARGIN_PX
    if warps.shape[1] > 6:
        reach += radius**2 * np.abs(warps[:, 9:] * np.array([0.5, 1.0, 0.5])).sum(axis=1)
    to_y = y + warps[:, 3]
    return int(np.floor((to_y - reach).min())), int(np.ceil((to_y + reach).max())) + 1


def propagation_rows(
    grid: kernel.KernelGrid, solution: kernel.Solution, radius: int, height: int
) -> Iterator[Rows]:
    """Yield rows of the deformed image that may show the points of some rows of the grid.

    The first rows are those to which the mean motion of the converged points takes all points of the grid.
    Each time more rows follow; the last are the whole image.

    `grid`: the points. `solution`: the results of these points; some of them have converged. `radius`: number
    of pixels of a subset on either side of its point. `height`: height of the deformed image.
    """
    row, column = np.nonzero(solution.converged)
    stride = max(1, len(row) // _SAMPLE)
    row, column = row[::stride], column[::stride]
    x, y = grid.x[column].astype(np.float64), grid.y[row].astype(np.float64)
    warps = solution.warps[row, column]
    slope_x, slope_y = np.median(warps[:, 4]), np.median(warps[:, 5])
    rest = y + warps[:, 3] - slope_x * x - (1.0 + slope_y) * y
    across = slope_x * np.array([grid.x[0], grid.x[-1]])
    down = (1.0 + slope_y) * np.array([grid.y[0], grid.y[-1]])
    reach = radius * (np.abs(slope_x) + np.abs(1.0 + slope_y)) + _MARGIN_PX
    top = rest.min() + across.min() + down.min() - reach
    bottom = rest.max() + across.max() + down.max() + reach + 1
    more = _MARGIN_PX
    while top > 0 or bottom < height:
        yield int(np.floor(top)), int(np.ceil(bottom))
        top, bottom, more = top - more, bottom + more, 2 * more
    yield 0, height
