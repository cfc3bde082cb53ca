"""Points beside cracks: of a subset that the region's edge cuts into parts, only the point's own counts."""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from dic.correlation.kernel import Reference
from dic.image.region import PointGrid, own_part
from dic.typing import Mask

_REACH = 3
"""Steps over which a neighbour's motion may be extrapolated to a point."""


class CutReference:
    """A reference image that can be limited to a part of one subset at a time.

    Parameters
    ----------
    reference : Reference
        Stays as it is; the planes are copied.
    """

    def __init__(self, reference: Reference) -> None:
        f, fx, fy, inside = (
            plane.copy() for plane in (reference.f, reference.fx, reference.fy, reference.inside)
        )
        self._planes = f, fx, fy, inside
        self._reference = reference._replace(f=f, fx=fx, fy=fy, inside=inside)

    @contextmanager
    def limited_to(self, x: int, y: int, usable: Mask, radius: int) -> Iterator[Reference]:
        """Give the reference without the pixels of a subset that do not hang together with its centre."""
        width = 2 * radius + 1
        first = self._reference.origin + (y - radius) * self._reference.pitch + x - radius
        elements = first + self._reference.pitch * np.arange(width)[:, None] + np.arange(width)
        outside = elements[~own_part(usable, x, y, radius)]
        kept = [plane[outside] for plane in self._planes]
        for plane in self._planes:
            plane[outside] = 0.0
        yield self._reference
        for plane, values in zip(self._planes, kept, strict=True):
            plane[outside] = values


def visible_neighbours(
    grid: PointGrid, usable: Mask, row: int, column: int, known: Mask
) -> Iterator[tuple[int, int]]:
    """Yield known points (row, column) near one, the nearest first, with no gap of the region in between.

    Parameters
    ----------
    grid : PointGrid
    usable : ndarray of bool, shape (height, width)
        The region.
    row, column : int
    known : ndarray of bool, shape (rows, columns)
        Points that may be given.
    """
    top, left = max(0, row - _REACH), max(0, column - _REACH)
    near = np.argwhere(known[top : row + _REACH + 1, left : column + _REACH + 1]) + np.array([top, left])
    nearest_first = np.argsort(((near - (row, column)) ** 2).sum(axis=1), kind="stable")
    for i, j in near[nearest_first]:
        other = int(i), int(j)
        if _in_sight(grid, usable, (row, column), other):
            yield other


def _in_sight(grid: PointGrid, usable: Mask, one: tuple[int, int], other: tuple[int, int]) -> bool:
    """Tell whether the straight line between two points stays in the region."""
    (x0, y0), (x1, y1) = (grid.x[one[1]], grid.y[one[0]]), (grid.x[other[1]], grid.y[other[0]])
    samples = 2 * max(abs(int(x1 - x0)), abs(int(y1 - y0))) + 1
    x, y = np.rint(np.linspace(x0, x1, samples)), np.rint(np.linspace(y0, y1, samples))
    return bool(usable[y.astype(int), x.astype(int)].all())
