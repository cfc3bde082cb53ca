"""What the kernel correlates and what it finds: a grid of points, and the solution of IC-GN at each."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dic.correlation.status import Status
from dic.typing import Float, Indices, Mask


class Grid(NamedTuple):
    """A grid of points in the reference.

    Attributes
    ----------
    x, y : ndarray of int, shapes (columns,) and (rows,)
        Coordinates, px.
    pixels : ndarray of int, shape (rows, columns)
        How many pixels of each subset lie in the region of interest.
    """

    x: Indices
    y: Indices
    pixels: Indices


class Solution(NamedTuple):
    """What IC-GN found, for points in a row or on a grid.

    Attributes
    ----------
    warps : ndarray, shape (…, 6 or 12)
    std : ndarray, shape (…, 6)
        Standard deviations of the first six parameters.
    status : ndarray of int8, shape (…)
        Values of `Status`.
    zncc : ndarray, shape (…)
    iterations : ndarray of int16, shape (…)
    """

    warps: Float
    std: Float
    status: NDArray[np.int8]
    zncc: Float
    iterations: NDArray[np.int16]

    @classmethod
    def empty(cls, shape: tuple[int, ...], parameters: int) -> "Solution":
        """Return a solution of so many points, none of which is reached yet."""
        return cls(
            np.zeros((*shape, parameters)),
            np.full((*shape, 6), np.nan),
            np.full(shape, Status.NOT_REACHED, np.int8),
            np.full(shape, np.nan),
            np.zeros(shape, np.int16),
        )

    def put(self, where: tuple[Indices, ...], part: "Solution") -> None:
        """Write the solution of some points in their places."""
        self.warps[where], self.std[where] = part.warps, part.std
        self.status[where], self.zncc[where] = part.status, part.zncc
        self.iterations[where] = part.iterations

    def part(self, where: slice | Indices | tuple[Indices, Indices]) -> "Solution":
        """Return a view of some rows of a grid, or a copy of the points of a list of places."""
        return Solution(
            self.warps[where],
            self.std[where],
            self.status[where],
            self.zncc[where],
            self.iterations[where],
        )

    @property
    def converged(self) -> Mask:
        """Which points have a value."""
        return np.asarray(self.status == Status.CONVERGED)
