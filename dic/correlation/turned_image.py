"""A deformed image that can be turned exactly by 90°, 180° or 270° before it is correlated."""

from dic.correlation import kernel
from dic.correlation.laid_rows import LaidDeformed
from dic.correlation.prepared_reference import PreparedReference
from dic.correlation.quarter_turn import turn_std, turn_warps
from dic.correlation.solver import Solver
from dic.image.stored import StoredImage
from dic.typing import Float, Indices


class TurnableImage:
    """A deformed image that can be turned by 90°, 180° or 270° before it is correlated."""

    def __init__(self, reference: PreparedReference, image: StoredImage) -> None:
        self.image = image
        self._reference = reference
        self._solvers: dict[int, Solver] = {}

    def solver(self, quarters: int) -> Solver:
        """Return the solver for the image that `numpy.rot90` has turned by `quarters` quarter turns."""
        if quarters not in self._solvers:
            # Keep one solver at a time, because a solver holds a whole image and a second is seldom needed.
            self._solvers.clear()
            order, threads = self._reference.settings.order, self._reference.threads
            laid = LaidDeformed(self.image.turned(quarters), order, self._reference.mean, threads)
            self._solvers[quarters] = Solver(self._reference, laid)
        return self._solvers[quarters]

    def turned(self, warps: Float, points: Indices, quarters: int) -> Float:
        """Return the guesses (n, 6) at `points` (n, 2), converted to the turned image."""
        return turn_warps(warps, points[:, 0], points[:, 1], self.image.shape, quarters)

    def turned_back(self, solution: kernel.Solution, quarters: int) -> kernel.Solution:
        """Convert a solution from the turned image to the original image."""
        if quarters == 0:
            return solution
        shape, grid = self.image.turned(quarters).shape, self._reference.grid
        return solution._replace(
            warps=turn_warps(solution.warps, grid.x, grid.y[:, None], shape, -quarters),
            std=turn_std(solution.std, quarters),
        )
