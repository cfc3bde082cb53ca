"""A deformed image that can be turned exactly by 90°, 180° or 270° before it is correlated."""

import numpy as np

from dic.correlation import kernel
from dic.correlation.prepared_reference import PreparedReference
from dic.correlation.quarter_turn import turn_std, turn_warps
from dic.correlation.solver import Solver
from dic.image.spline import spline_image
from dic.typing import Float, Grey, Indices


class TurnableImage:
    """A deformed image that can be turned by 90°, 180° or 270° before it is correlated.

    Parameters
    ----------
    reference : PreparedReference
    grey : ndarray of float32, shape (height, width)
    """

    def __init__(self, reference: PreparedReference, grey: Grey) -> None:
        self.grey = grey
        self._reference = reference
        self._solvers: dict[int, Solver] = {}

    def solver(self, quarters: int) -> Solver:
        """Return the solver for the image that `numpy.rot90` has turned by `quarters` quarter turns."""
        if quarters not in self._solvers:
            # Keep one solver at a time, because a solver holds a whole image and a second is seldom needed.
            self._solvers.clear()
            order, threads = self._reference.settings.order, self._reference.threads
            spline = spline_image(np.rot90(self.grey, quarters), order, threads)
            laid = kernel.lay_coefficients(spline, self._reference.mean, threads)
            self._solvers[quarters] = Solver(self._reference, laid)
        return self._solvers[quarters]

    def turned(self, warps: Float, points: Indices, quarters: int) -> Float:
        """Return the guesses (n, 6) at `points` (n, 2), converted to the turned image."""
        height, width = self.grey.shape
        return turn_warps(warps, points[:, 0], points[:, 1], (height, width), quarters)

    def turned_back(self, solution: kernel.Solution, quarters: int) -> kernel.Solution:
        """Convert a solution from the turned image to the original image."""
        if quarters == 0:
            return solution
        height, width = np.rot90(self.grey, quarters).shape
        grid = self._reference.grid
        return solution._replace(
            warps=turn_warps(solution.warps, grid.x, grid.y[:, None], (height, width), -quarters),
            std=turn_std(solution.std, quarters),
        )
