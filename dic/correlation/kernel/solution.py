"""Input and output of the kernel: a grid of points, and the result of IC-GN at each point."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dic.correlation.status import Status
from dic.typing import Float, Indices, Mask


class KernelGrid(NamedTuple):
    """A grid of points in the reference."""

    x: Indices
    y: Indices
    """Shape (columns,) and (rows,). Coordinates of the columns and of the rows of points, px."""
    pixels: Indices
    """Shape (rows, columns). Number of pixels of each subset in the region of interest."""


class Solution(NamedTuple):
    """The results of IC-GN for a list or a grid of points."""

    warps: Float
    """Shape (…, 6 or 12). Warp of each point."""
    std: Float
    """Shape (…, 6). Standard deviations of the first six warp parameters."""
    status: NDArray[np.int8]
    """Shape (…). Status of each point, a value of `Status`."""
    zncc: Float
    """Shape (…). Correlation coefficient of each point."""
    iterations: NDArray[np.int16]
    """Shape (…). Number of iterations at each point."""

    @classmethod
    def empty(cls, shape: tuple[int, ...], parameters: int) -> "Solution":
        """Return a solution for points of the given shape, with the status "not reached" for every point."""
        return cls(
            np.zeros((*shape, parameters)),
            np.full((*shape, 6), np.nan),
            np.full(shape, Status.NOT_REACHED, np.int8),
            np.full(shape, np.nan),
            np.zeros(shape, np.int16),
        )

    def copy(self) -> "Solution":
        """Return a copy of all arrays."""
        return Solution(
            self.warps.copy(),
            self.std.copy(),
            self.status.copy(),
            self.zncc.copy(),
            self.iterations.copy(),
        )

    def put(self, where: tuple[Indices | slice, ...], part: "Solution") -> None:
        """Write the solution `part` to the points at the indices `where`."""
        self.warps[where], self.std[where] = part.warps, part.std
        self.status[where], self.zncc[where] = part.status, part.zncc
        self.iterations[where] = part.iterations

    def part(self, where: slice | Indices | tuple[Indices, Indices]) -> "Solution":
        """Return the solution at some points: a view for a slice of rows, a copy for indices of points."""
        return Solution(
            self.warps[where],
            self.std[where],
            self.status[where],
            self.zncc[where],
            self.iterations[where],
        )

    @property
    def converged(self) -> Mask:
        """A mask that is True for converged points."""
        return np.asarray(self.status == Status.CONVERGED)


class Task(NamedTuple):
    """The points of a grid that are to be solved."""

    seeds: Indices
    """Shape (n, 2). Row and column of points that start from their own warps."""
    propagates: bool
    """True to continue from the converged points to their neighbours."""
    pending: Mask
    """Shape (rows, columns). True for points that are still to be solved."""
