"""Reduce a displacement field to the polynomial of third degree that fits it, with its errors."""

from dataclasses import dataclass

import numpy as np

from dic.out_of_plane.causes import CameraSight
from dic.out_of_plane.correction import by_centre
from dic.out_of_plane.plane import Plane
from dic.out_of_plane.uncertainty import Points, weighted_sums
from dic.strain.fit import gradient_weights
from dic.typing import Float

_DEGREE = 3

COEFFICIENTS = slice(0, 20)
GRADIENT = slice(20, 24)
"""The rows of a `Polynomial`: ten coefficients for each component, then the elements of the mean gradient."""


@dataclass(frozen=True)
class Polynomial:
    """The polynomial of third degree that fits a displacement field, and its errors.

    The rows `COEFFICIENTS` are the coefficients, 10 for each component. The rows `GRADIENT` are the elements
    xx, xy, yx, yy of the mean displacement gradient.
    """

    points: Points
    weights: Float
    """Shape (n, 2, 24). Weights of the displacements in the 24 rows."""
    noise: Float
    by_calibration: Float
    still: Float
    """Shape (24, 24). Covariances of the 24 rows by the noise of the images, by the calibration, and by the
    errors that still images show.
    """

    @classmethod
    def of(cls, points: Points, centre_mm: Float, smooth_px: float | None = None) -> "Polynomial":
        """Return the polynomial's weights and errors; `smooth_px` is the size of smooth errors."""
        terms = np.linalg.pinv(polynomial_terms(points.before_mm)).T
        none = np.zeros_like(terms)
        coefficients = np.stack([np.hstack([terms, none]), np.hstack([none, terms])], axis=1)
        weights = np.concatenate([coefficients, gradient_weights(points.before_mm)], axis=2)

        def estimate(centre_mm: Float) -> Float:
            return weighted_sums(
                weights, CameraSight(points.before_mm, points.after_mm, centre_mm).moved(Plane())
            )

        noise = points.noise_covariance(weights) + points.smooth_covariance(weights, _DEGREE, smooth_px)
        of_map, of_centre = points.calibration_factors(weights)
        factors = of_map + by_centre(estimate, centre_mm) @ of_centre
        by_calibration = np.asarray(factors @ factors.T)
        return cls(points, weights, noise, by_calibration, points.still_covariance(weights))

    def rows(self, field: Float) -> Float:
        """Return the 24 rows of a displacement field (n, 2), or of several fields (n, 2, k)."""
        return weighted_sums(self.weights, field)

    def residual_mm(self, field: Float) -> Float:
        """Return the part of a displacement field (n, 2) that the polynomial does not fit."""
        terms = polynomial_terms(self.points.before_mm)
        return np.asarray(field - terms @ self.rows(field)[COEFFICIENTS].reshape(2, 10).T)


def polynomial_terms(position_mm: Float) -> Float:
    """Return the ten terms of a polynomial of third degree at `position_mm` (n, 2), shape (n, 10)."""
    centred = position_mm - position_mm.mean(axis=0)
    x, y = (centred / np.abs(centred).max()).T
    powers = [(degree - k, k) for degree in range(_DEGREE + 1) for k in range(degree + 1)]
    return np.stack([x**i * y**j for i, j in powers], axis=1)
