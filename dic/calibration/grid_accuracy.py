"""The deviations of a calibration grid from its nominal shape, which all its points share.

The residuals of one image hardly show these deviations. Several images of the tilted grid, or of cameras that
look from different directions, do.
"""

from dataclasses import dataclass

import numpy as np

from dic.calibration.grid_making import EXACT, GridAccuracy
from dic.typing import Float, Mask

_CLOSE = 0.05

DEVIATIONS = ("scale ratio", "skew", "bow along X", "twist", "bow along Y")
"""Names of the deviations g that a fit of a pinhole camera estimates, in their order.

The scale ratio g₁ and the skew g₂ move a point in the grid's plane:

    X = x (1 + g₁/2) + y g₂/2,    Y = y (1 − g₁/2) + x g₂/2

The other three, in mm, bend the grid with the half widths a and b:

    Z = g₃ (x²/a² − 1/3) + g₄ x y/(a b) + g₅ (y²/b² − 1/3)
"""


@dataclass(frozen=True)
class KnownGrid:
    """What is known of a grid's deviations before a fit."""

    mean: Float
    """Shape (5,). Expected deviations."""
    covariance: Float
    """Shape (5, 5). Their covariance; 0 for deviations that the grid does not have."""

    @classmethod
    def of(cls, accuracy: GridAccuracy) -> "KnownGrid":
        """Return what the accuracy of a grid tells."""
        return cls(np.zeros(len(DEVIATIONS)), np.diag(np.square(accuracy.std)))

    @property
    def free(self) -> Mask:
        """Shape (5,). True for the deviations that the grid may have."""
        return np.diag(self.covariance) > 0

    def is_close(self, other: "KnownGrid") -> bool:
        """Return True if the other's deviations are the same to a twentieth of their standard deviation."""
        std = np.sqrt(np.diag(self.covariance))
        return bool((np.abs(self.mean - other.mean) <= _CLOSE * std).all())

    @property
    def weights(self) -> Float:
        """Matrix W, shape (k, 5), for which W (g − mean) are k independent deviations with variance 1."""
        free = self.free
        weights = np.zeros((np.count_nonzero(free), len(free)))
        weights[:, free] = np.linalg.cholesky(np.linalg.inv(self.covariance[np.ix_(free, free)])).T
        return weights


FLAT = KnownGrid.of(EXACT)


def deviated(xy_mm: Float, half_mm: Float, deviations: Float) -> tuple[Float, Float]:
    """Return the true places (n, 3), mm, of grid points (n, 2), and their derivatives (n, 3, 5).

    `half_mm`, shape (2,): half widths of the grid along X and Y.
    """
    x, y = xy_mm.T
    slopes = np.zeros((len(x), 3, len(DEVIATIONS)))
    slopes[:, 0, 0], slopes[:, 1, 0] = x / 2, -y / 2
    slopes[:, 0, 1], slopes[:, 1, 1] = y / 2, x / 2
    across, up = (xy_mm / half_mm).T
    slopes[:, 2, 2:] = np.stack([across**2 - 1 / 3, across * up, up**2 - 1 / 3], axis=1)
    return np.column_stack([xy_mm, np.zeros(len(x))]) + slopes @ deviations, slopes
