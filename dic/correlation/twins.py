"""Twins: places one or more periods away, where a subset of a pattern that repeats matches nearly as well."""

from typing import NamedTuple

import numpy as np

from dic.correlation.prepared_reference import PreparedReference
from dic.correlation.repetition import Repetition
from dic.correlation.solver import Solver
from dic.image.stored import StoredImage
from dic.typing import Float, Indices, Mask

_NEAR = 0.3
"""A twin that was found lies within this part of the period of the place where it was expected."""
_ITERATIONS = 8
"""A place that is alike is found after fewer iterations; elsewhere they need not end."""
_SAMPLE = 400
_MARGIN_PX = 2
_ALIKE, _OTHER = 0.005, 0.3
"""A point whose residual is less has a twin; where it is more at whole pixels, no iterations are needed."""


class Unlike(NamedTuple):
    """By how much points of the reference differ from their twins in the reference itself."""

    indices: Indices
    """Shape (n, 2). Row and column of the points on the grid."""
    residuals: Float
    """Shape (n,). Residual 1 - ZNCC of the most similar twin; NaN if it is not known."""


class Twins:
    """Compare subsets with their twins."""

    def __init__(self, reference: PreparedReference, repetition: Repetition) -> None:
        self._grid, self._settings = reference.grid, reference.settings
        self.repetition = repetition
        self.shortest_px = float(repetition.periods_px.min())

    def residuals(self, solver: Solver, indices: Indices, warps: Float) -> Float:
        """Return the residuals 1 - ZNCC of all twins of points, shape (twins, points)."""
        steps = self.repetition.twins_at(self._grid.points_at(indices))
        return np.array([self.residual(solver, indices, warps, step) for step in steps])

    def residual(self, solver: Solver, indices: Indices, warps: Float, step: Float) -> Float:
        """Return the residuals 1 - ZNCC of points (n,) if they lie a `step` (n, 2) of the reference farther.

        A residual is NaN where the twin is out of view or the iterations lead to another place.
        """
        guess = stepped(warps, step)
        solved = solver.solve(indices, guess, _ITERATIONS)
        off_px = np.hypot(solved.warps[:, 0] - guess[:, 0], solved.warps[:, 3] - guess[:, 3])
        known = ~solved.converged | (off_px < _NEAR * self.shortest_px)
        return np.where(known, 1.0 - solved.zncc, np.nan)

    def away(self, indices: Indices, warps: Float, multiples: Float) -> Float:
        """Return guesses (n, 6) for points that lie `multiples` (1 or 2) of the periods farther."""
        return stepped(warps, multiples @ self.repetition.vectors_at(self._grid.points_at(indices)))

    def unlike(self, solver: Solver, image: StoredImage) -> Unlike:
        """Return by how much points spread over the grid differ from their twins in the same image.

        `solver`: solver whose deformed image is the reference `image`.
        """
        indices = side_by_side(self._grid.active, 1, _SAMPLE)
        points = self._grid.points_at(indices)
        steps = self.repetition.twins_at(points)
        least, known = np.full(len(indices), np.inf), np.zeros(len(indices), np.int64)
        for step in steps:
            left = np.flatnonzero(least > _ALIKE)
            places = np.rint(points[left] + step[left]).astype(np.int64)
            # The iterations may fail at a place that is alike, and whole pixels miss the best place by up to
            # half a pixel. So the smaller residual counts.
            whole = np.array(
                [self._whole_pixel(image, *pair) for pair in zip(points[left], places, strict=True)]
            )
            near = whole < _OTHER
            still = np.zeros((np.count_nonzero(near), 6))
            solved = self.residual(solver, indices[left[near]], still, step[left[near]])
            whole[near] = np.fmin(whole[near], solved)
            known[left] += np.isfinite(whole)
            least[left] = np.fmin(least[left], whole)
        return Unlike(
            indices, np.where(2 * known >= len(steps), least, np.where(least > _ALIKE, np.nan, least))
        )

    def _whole_pixel(self, image: StoredImage, at: Indices, there: Indices) -> float:
        """Return the residual 1 - ZNCC of a subset at whole pixels around another place; NaN out of view."""
        import cv2

        r, (height, width) = self._settings.radius_px, image.shape
        (x, y), (left, top) = at.tolist(), (there - r - _MARGIN_PX).tolist()
        side = 2 * (r + _MARGIN_PX) + 1
        if left < 0 or top < 0 or left + side > width or top + side > height:
            return np.nan
        template = image.part(slice(y - r, y + r + 1), slice(x - r, x + r + 1))
        window = image.part(slice(top, top + side), slice(left, left + side))
        return 1.0 - float(cv2.matchTemplate(window, template, cv2.TM_CCOEFF_NORMED).max())


def side_by_side(points: Mask, stride: int, most: int) -> Indices:
    """Return at most `most` points (row, column) of a grid, at least `stride` rows and columns apart."""
    rows, columns = np.nonzero(points)
    while True:
        chosen = (rows % stride == stride // 2) & (columns % stride == stride // 2)
        if np.count_nonzero(chosen) <= most:
            return np.stack([rows[chosen], columns[chosen]], axis=1)
        stride += 1


def stepped(warps: Float, step: Float) -> Float:
    """Return guesses (n, 6): warps of points that lie a `step` (n, 2) of the reference farther."""
    guess: Float = warps[:, :6].copy()
    guess[:, 0] += step[:, 0] + guess[:, 1] * step[:, 0] + guess[:, 2] * step[:, 1]
    guess[:, 3] += step[:, 1] + guess[:, 4] * step[:, 0] + guess[:, 5] * step[:, 1]
    return guess
