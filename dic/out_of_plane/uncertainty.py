"""Covariances of estimates that are weighted sums of displacements.

A least-squares estimate is, to first order, a weighted sum of displacements. Its error is the same sum of the
displacements' errors. These come from the noise of the images, which neighbours share where their subsets
overlap, from interpolation, and from the calibration, which all points share.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dic.calibration.calibration import Calibration
from dic.strain.displacement import Displacement
from dic.strain.fit import covariance_of_sums, slopes_of
from dic.typing import Float, Mask

_SMOOTH_PX = 0.0004
"""Displacement errors of interpolation. They change with the sub-pixel part of the displacement and are
therefore common to whole areas of the field. Measured on rendered images by benchmarks.order."""

_DETERMINED = 1e8
"""Largest condition number of normal equations that are solved."""


@dataclass(frozen=True)
class Points:
    """The valid points of a displacement field, and the propagation of their errors to weighted sums.

    Attributes
    ----------
    displacement : Displacement
        Calibrated, in mm.
    use : ndarray of bool, shape (rows, columns)
        The points used; n of them.
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
        """Return whether the points determine polynomials of this degree, 1 or 2."""
        centred = self.before_mm - self.before_mm.mean(axis=0)
        x, y = (centred / max(float(np.abs(centred).max(initial=0.0)), 1e-12)).T
        terms = [np.ones_like(x), x, y] + ([x * x, x * y, y * y] if degree == 2 else [])
        design = np.column_stack(terms)
        return len(x) > len(terms) and bool(np.linalg.cond(design.T @ design) < _DETERMINED)

    def noise_covariance(self, weights: Float) -> Float:
        """Return the covariance (p, p) of the sums Σ weights · displacement from noise.

        Parameters
        ----------
        weights : ndarray, shape (n, 2, p)
        """
        if self.displacement.noise is None:
            raise ValueError("these displacements come without their noise")
        on_grid = np.zeros((*self.use.shape, *weights.shape[1:]))
        on_grid[self.use] = weights
        return covariance_of_sums(on_grid, self.displacement.noise)

    def smooth_covariance(self, weights: Float) -> Float:
        """Return the covariance (p, p) of the sums Σ weights · displacement from interpolation.

        The sub-pixel part of the displacement of a strained specimen varies over the field as slowly as the
        displacement. These errors are therefore modelled as polynomials of first and second degree, with the
        value `_SMOOTH_PX` at the outermost points.

        Parameters
        ----------
        weights : ndarray, shape (n, 2, p)
        """
        centred = self.before_mm - self.before_mm.mean(axis=0)
        x, y = (centred / np.abs(centred).max()).T
        terms = _SMOOTH_PX * self.calibration.mm_per_px * np.stack([x, y, x * x, x * y, y * y], axis=1)
        factors = np.einsum("nip,nk->pik", weights, terms).reshape(weights.shape[2], -1)
        return np.asarray(factors @ factors.T)

    def calibration_factors(self, weights: Float) -> tuple[Float, Float]:
        """Return the effect of calibration errors of unit variance on the sums and on the camera's centre.

        Errors of a pinhole's map and centre are correlated: if the grid appears too large, the camera is
        estimated too near. Errors of the bicubic map are taken as independent of the centre. A column belongs
        to the same error for all fields that share a calibration.

        Parameters
        ----------
        weights : ndarray, shape (n, 2, p)

        Returns
        -------
        of_map : ndarray, shape (p, q)
            F; errors of the map give the sums the covariance F Fᵀ.
        of_centre : ndarray, shape (3, q)
            The same for the centre, mm.
        """
        if self.calibration.pinhole is None:
            raise ValueError("this calibration knows no camera centre")
        before, after = (self.calibration.error_factors(px) for px in self.px)
        # An error of the reference position x changes the expected position F x of the deformed point by F
        # times it.
        F = slopes_of(self.before_mm, self.after_mm - self.before_mm) + np.eye(2)
        of_map = np.einsum("nip,niq->pq", weights, after - F @ before)
        of_centre = self.calibration.pinhole.centre_factors()
        if self.calibration.model == "bicubic":
            own, others = of_map.shape[1], of_centre.shape[1]
            of_map = np.pad(of_map, ((0, 0), (0, others)))
            of_centre = np.pad(of_centre, ((0, 0), (own, 0)))
        return np.asarray(of_map), of_centre

    def covariance(self, weights: Float, by_centre: Float | None = None) -> Float:
        """Return the covariance (p, p) of estimates from noise, interpolation and calibration together.

        Parameters
        ----------
        weights : ndarray, shape (n, 2, p)
            Weights of the displacements in the estimates.
        by_centre : ndarray, shape (p, 3), optional
            Derivative of the estimates by the camera's centre, per mm.
        """
        of_map, of_centre = self.calibration_factors(weights)
        factors = of_map if by_centre is None else of_map + by_centre @ of_centre
        by_images = self.noise_covariance(weights) + self.smooth_covariance(weights)
        return np.asarray(by_images + factors @ factors.T)


def block_diagonal(blocks: Sequence[Float]) -> Float:
    """Return the matrix with these blocks on its diagonal and 0 elsewhere."""
    from scipy.linalg import block_diag

    return np.asarray(block_diag(*blocks))
