"""Estimates as weighted sums of displacements, and their covariances.

Least squares make an estimate a weighted sum of displacements, at least to first order. Its errors are the
same sum of theirs: of the noise of the images, which neighbours share where their subsets overlap, and of the
calibration, which all points share.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dic.calibration.calibration import Calibration
from dic.strain.displacement import Displacement
from dic.strain.fit import covariance_of_sums, slopes_of

Float = NDArray[np.float64]
Mask = NDArray[np.bool_]

_SMOOTH_PX = 0.0004
"""Displacement errors that points share over the whole field: those of interpolation, which change with the
fraction of a pixel that points moved. Measured on rendered images, benchmarks.order."""

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

    def smooth_covariance(self, weights: Float) -> Float:
        """Return the covariance (p, p) that interpolation gives to the sums Σ weights · displacement.

        A strained specimen moves by other fractions of a pixel at every place, so these errors vary over the
        field as slowly as displacements do: as polynomials of first and second degree, of `_SMOOTH_PX` at the
        points farthest out.

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
        """Return what errors of unit variance of the calibration do to the sums and to the camera's centre.

        A pinhole's map and centre err together: a grid seen too large is a camera thought too near. The
        bicubic map's errors are taken as independent of the centre's. The same column belongs to the same
        error for all fields that share a calibration.

        Parameters
        ----------
        weights : ndarray, shape (n, 2, p)

        Returns
        -------
        of_map : ndarray, shape (p, q)
            F; through the map the sums get the covariance F Fᵀ.
        of_centre : ndarray, shape (3, q)
            The same of the centre, mm.
        """
        if self.calibration.pinhole is None:
            raise ValueError("this calibration knows no camera centre")
        before, after = (self.calibration.error_factors(px) for px in self.px)
        # A wrong position x of the reference displaces x + u, wanted at F x, by F times as much.
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
            By which displacements enter them.
        by_centre : ndarray, shape (p, 3), optional
            Their derivative by the camera's centre, per mm.
        """
        of_map, of_centre = self.calibration_factors(weights)
        factors = of_map if by_centre is None else of_map + by_centre @ of_centre
        by_images = self.noise_covariance(weights) + self.smooth_covariance(weights)
        return np.asarray(by_images + factors @ factors.T)


def block_diagonal(blocks: Sequence[Float]) -> Float:
    """Return the matrix with these blocks along its diagonal, 0 elsewhere."""
    from scipy.linalg import block_diag

    return np.asarray(block_diag(*blocks))
