"""Estimates as weighted sums of displacements, and their covariances.

Least squares make an estimate a weighted sum of displacements, at least to first order. Its errors are the
same sum of theirs: of the noise of the images, which neighbours share where their subsets overlap, and of the
calibration, which all points share.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dic.calibration import Calibration
from dic.displacement import Displacement
from dic.strain_fit import covariance_of_sums

Float = NDArray[np.float64]
Mask = NDArray[np.bool_]

_DETERMINED = 1e8
"""Condition number of normal equations up to which they are solved."""


@dataclass(frozen=True)
class Points:
    """The valid points of a displacement field in a row, and how errors reach sums of them.

    Attributes
    ----------
    displacement : Displacement
        Calibrated, in mm.
    use : ndarray of bool, shape (rows, columns)
        Which points; n of them.
    px : ndarray, shape (2, n, 2)
        The points in the reference and in the deformed image.
    calibration : Calibration
    """

    displacement: Displacement
    use: Mask
    px: Float
    calibration: Calibration

    @property
    def before_mm(self) -> Float:
        """Calibrated positions in the reference, (n, 2)."""
        return self.displacement.position[self.use]

    @property
    def after_mm(self) -> Float:
        """Calibrated positions in the deformed image, (n, 2)."""
        return self.before_mm + self.displacement.vector[self.use]

    def determine(self, degree: int) -> bool:
        """Tell whether the points lie so that they determine polynomials of this degree, 1 or 2."""
        centred = self.before_mm - self.before_mm.mean(axis=0)
        x, y = (centred / max(float(np.abs(centred).max(initial=0.0)), 1e-12)).T
        terms = [np.ones_like(x), x, y] + ([x * x, x * y, y * y] if degree == 2 else [])
        design = np.column_stack(terms)
        return len(x) > len(terms) and bool(np.linalg.cond(design.T @ design) < _DETERMINED)

    def noise_covariance(self, weights: Float) -> Float:
        """Return the covariance (p, p) that noise gives to the sums Σ weights · displacement.

        Parameters
        ----------
        weights : ndarray, shape (n, 2, p)
        """
        if self.displacement.noise is None:
            raise ValueError("these displacements come without their noise")
        on_grid = np.zeros((*self.use.shape, *weights.shape[1:]))
        on_grid[self.use] = weights
        return covariance_of_sums(on_grid, self.displacement.noise)

    def calibration_factors(self, weights: Float) -> Float:
        """Return F (p, q) with the covariance F Fᵀ that the calibration's errors give to the sums.

        The same columns of F belong to the same error for all fields that share a calibration.
        """
        before, after = (self.calibration.error_factors(px) for px in self.px)
        return np.asarray(np.einsum("nip,niq->pq", weights, after - before))

    def covariance(self, weights: Float) -> Float:
        """Return the covariance (p, p) of the sums from noise and calibration together."""
        factors = self.calibration_factors(weights)
        return np.asarray(self.noise_covariance(weights) + factors @ factors.T)
