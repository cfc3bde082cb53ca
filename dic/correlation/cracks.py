"""Points beside cracks: if a crack cuts a subset into parts, only the part around the point is used."""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from dic.correlation.kernel import Reference
from dic.image.point_grid import PointGrid, connected_part
from dic.typing import Mask

_NEIGHBOUR_REACH = 3
"""Largest distance of a point beside a crack from the neighbour that gives its first guess, in grid steps."""


class CutReference:
    """A reference image in which the pixels beyond a crack can be hidden, for one subset at a time.

    Parameters
    ----------
    reference : Reference
        The reference image, which is copied and not changed.
    """

    def __init__(self, reference: Reference) -> None:
        f, fx, fy, inside = (
            plane.copy() for plane in (reference.f, reference.fx, reference.fy, reference.inside)
        )
        self._planes = f, fx, fy, inside
        self._reference = reference._replace(f=f, fx=fx, fy=fy, inside=inside)

    @contextmanager
    def limited_to(self, x: int, y: int, usable: Mask, radius: int) -> Iterator[Reference]:
        """Provide a reference in which one subset lacks the pixels beyond a crack.

        A pixel of the subset is hidden if a crack separates the pixel from the subset's centre (x, y).
        """
        width = 2 * radius + 1
        first = self._reference.origin + (y - radius) * self._reference.pitch + x - radius
        elements = first + self._reference.pitch * np.arange(width)[:, None] + np.arange(width)
        hidden = elements[~connected_part(usable, x, y, radius)]
        values = [plane[hidden] for plane in self._planes]
        for plane in self._planes:
            plane[hidden] = 0.0
        try:
            yield self._reference
        finally:
            for plane, before in zip(self._planes, values, strict=True):
                plane[hidden] = before


def visible_neighbours(
    grid: PointGrid, usable: Mask, row: int, column: int, known: Mask
) -> Iterator[tuple[int, int]]:
    """Yield points of `known` near a given point, if the line between the two points is in the region.

    Parameters
    ----------
    grid : PointGrid
    usable : ndarray of bool, shape (height, width)
        True for pixels of the region.
    row, column : int
        The given point.
    known : ndarray of bool, shape (rows, columns)
        True for points that may be chosen.

    Yields
    ------
    (int, int)
        Row and column of a known point; the nearest point comes first.
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
