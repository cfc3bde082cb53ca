"""Points beside cracks: if a crack cuts a subset into parts, only the part around the point is used."""

from collections.abc import Iterator

import numpy as np

from dic.correlation.kernel import KernelReference
from dic.image.point_grid import PointGrid, connected_part
from dic.typing import Mask

_VECTOR = 16
"""Number of elements of the longest vector of the kernel."""

_NEIGHBOUR_REACH = 3
"""Largest distance of a point beside a crack from the neighbour that gives its first guess, in grid steps."""


def limited_to(reference: KernelReference, x: int, y: int, usable: Mask, radius: int) -> KernelReference:
    """Return a reference that holds one subset only, without the pixels beyond a crack.

    `x`, `y`: centre of the subset. A pixel of the subset is hidden if a crack separates it from the centre.
    `usable`, shape (height, width): True for pixels that subsets may use. `radius`: number of pixels of the
    subset on either side of its centre.
    """
    width = 2 * radius + 1
    first = reference.origin + (y - radius) * reference.pitch + x - radius
    elements = first + reference.pitch * np.arange(width)[:, None] + np.arange(width)
    hidden = ~connected_part(usable, x, y, radius)
    # The kernel reads a vector at the end of a row to its last element, and multiplies what is beyond the
    # subset by 0.
    pitch = width + _VECTOR
    planes = []
    for plane in (reference.f, reference.fx, reference.fy, reference.inside):
        subset = np.zeros((width, pitch), np.float32)
        subset[:, :width] = np.where(hidden, np.float32(0.0), plane[elements])
        planes.append(subset.ravel())
    f, fx, fy, inside = planes
    origin = -((y - radius) * pitch + x - radius)
    return reference._replace(f=f, fx=fx, fy=fy, inside=inside, pitch=pitch, origin=origin)


def visible_neighbours(
    grid: PointGrid, usable: Mask, row: int, column: int, known: Mask
) -> Iterator[tuple[int, int]]:
    """Yield row and column of points of `known` near a given point, the nearest point first.

    The line between the given point at `row` and `column` and a yielded point is in the region. `usable`,
    shape (height, width): True for pixels of the region. `known`, shape (rows, columns): True for points that
    may be chosen.
    """
    reach = _NEIGHBOUR_REACH
    top, left = max(0, row - reach), max(0, column - reach)
    near = np.argwhere(known[top : row + reach + 1, left : column + reach + 1]) + np.array([top, left])
    nearest_first = np.argsort(((near - (row, column)) ** 2).sum(axis=1), kind="stable")
    for i, j in near[nearest_first]:
        other = int(i), int(j)
        if _line_is_inside(grid, usable, (row, column), other):
            yield other


def _line_is_inside(grid: PointGrid, usable: Mask, one: tuple[int, int], other: tuple[int, int]) -> bool:
    """Return True if the straight line between two points stays in the region."""
    (x0, y0), (x1, y1) = (grid.x[one[1]], grid.y[one[0]]), (grid.x[other[1]], grid.y[other[0]])
    samples = 2 * max(abs(int(x1 - x0)), abs(int(y1 - y0))) + 1
    x, y = np.rint(np.linspace(x0, x1, samples)), np.rint(np.linspace(y0, y1, samples))
    return bool(usable[y.astype(int), x.astype(int)].all())
