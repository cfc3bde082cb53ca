"""Seeds: a few points spread over the region, whose guesses are confirmed by IC-GN and by neighbours."""

from typing import NamedTuple

import numpy as np

from dic.correlation.consistency import consistent_seeds
from dic.correlation.features import FeatureFinder
from dic.correlation.initial_guess import guesses
from dic.correlation.kernel import Solution
from dic.correlation.prepared_reference import PreparedReference
from dic.correlation.quarter_turn import quarters_of
from dic.correlation.status import Status
from dic.correlation.turned_image import TurnableImage
from dic.image.stored import StoredImage
from dic.typing import Float, Indices, Mask

FEWEST_SEEDS = 3
"""Smallest number of consistent seeds with which propagation begins.

In a region with fewer points, all points must be consistent.
"""

_SEEDS = 48
"""Approximate number of points that are tried as seeds."""

_ENOUGH_SEEDS = 0.3
"""If at least this fraction of the tried points in view become seeds, no further first guess is tried."""

_SMALLEST_TEMPLATE_RADIUS_PX = 15


class Seeds(NamedTuple):
    """Seeds, which are the points from which propagation starts."""

    start: str
    """Name of the first guess from which the seeds converged, such as "previous", "hint", "search" or
    "features".
    """
    quarters: int
    """Number of quarter turns by which the deformed image was turned."""
    indices: Indices
    """Shape (n, 2). Row and column of the seeds on the grid of points."""
    solution: Solution
    """Warps and other results of the seeds in the turned image."""


class SeedFinder:
    """Find seeds (start points of the propagation) for deformed images with one reference.

    `image`: the smoothed reference.
    """

    def __init__(self, reference: PreparedReference, image: StoredImage) -> None:
        self._reference, self._image = reference, image
        self._features = FeatureFinder(image, reference.grid.usable)

    def find(
        self,
        image: TurnableImage,
        indices: Indices,
        *,
        previous: Float | None = None,
        hint: Float | None = None,
        near_px: int | None = None,
        quarters: int | None = None,
    ) -> Seeds:
        """Try first guesses, and return the seeds from the guess that gives the most consistent points.

        `indices`, shape (n, 2): row and column of the points to try. `previous`, shape (n, 6): warps of the
        points in an earlier image. `hint`, shape (3, 3): expected homography from the reference to the
        deformed image. `near_px`: as for `guesses`. `quarters`: number of quarter turns of the image. By
        default the number of quarter turns follows from each first guess.

        Result: the seeds; their number may be 0.
        """
        settings, points = self._reference.settings, self._reference.grid.points_at(indices)
        template_radius_px = max(settings.radius_px, _SMALLEST_TEMPLATE_RADIUS_PX)
        best = Seeds("", 0, indices[:0], Solution.empty((0,), settings.parameters))
        for name, guess in guesses(
            self._image, image.image, self._features, points, template_radius_px,
            previous=previous, hint=hint, near_px=near_px, threads=self._reference.threads,
        ):  # fmt: skip
            turn = quarters_of(guess) if quarters is None else quarters
            solved = image.solver(turn).solve(indices, image.turned(guess, points, turn))
            consistent = solved.converged
            consistent[consistent] = consistent_seeds(points[consistent], solved.warps[consistent])
            if consistent.sum() > len(best.indices):
                best = Seeds(name, turn, indices[consistent], solved.part(np.flatnonzero(consistent)))
            in_view = np.count_nonzero(solved.status != Status.OUT_OF_VIEW)
            if len(best.indices) >= max(min(FEWEST_SEEDS, len(points)), _ENOUGH_SEEDS * in_view):
                break
        return best


def scattered(points: Mask) -> Indices:
    """Return about 48 indices (row, column) or fewer, spread evenly over the True elements of a mask."""
    rows, columns = np.nonzero(points)
    stride = max(1, round(np.sqrt(rows.size / _SEEDS)))
    while True:
        chosen = (rows % stride == stride // 2) & (columns % stride == stride // 2)
        if chosen.sum() >= min(_SEEDS // 2, rows.size) or stride == 1:
            return np.stack([rows[chosen], columns[chosen]], axis=1)
        stride -= 1
