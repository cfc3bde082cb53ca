"""Reduce a displacement field to the polynomial of third degree that fits it, with its errors."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from dic.out_of_plane.causes import CameraSight
from dic.out_of_plane.plane import Plane
from dic.out_of_plane.uncertainty import Points, of_both_components
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
    terms: Float
    """Shape (n, 10). The terms of the polynomial at the points."""
    to_rows: Float
    """Shape (24, 20). The mean gradient depends on the displacements only through the coefficients."""
    sight: CameraSight
    """The positions of the points, with the weights of the 24 rows."""
    by_images: Float
    by_calibration: Float
    still: Float
    """Shape (24, 24). Covariances of the 24 rows by the noise of the images, by the calibration, and by the
    errors that still images show.
    """
    smooth_px: float | None = None
    """Size of smooth errors, for `Points.smooth_covariance`."""

    @classmethod
    def of(cls, points: Points, centre_mm: Float) -> "Polynomial":
        """Return the polynomial's weights and errors; `centre_mm` (3,) is the camera's centre."""
        terms = polynomial_terms(points.before_mm)
        weights = np.asarray(np.linalg.solve(terms.T @ terms, terms.T).T)
        centred = points.before_mm - points.before_mm.mean(axis=0)
        slopes = np.linalg.solve(centred.T @ centred, centred.T @ terms)
        to_rows = np.vstack([np.eye(20), np.kron(np.eye(2), slopes)])
        sight = CameraSight.of(points.before_mm, points.after_mm, centre_mm, weights)
        before, after = (
            replace(nodes, weights=nodes.weights @ to_rows.T) for nodes in (sight.before, sight.after)
        )
        both = of_both_components(weights)
        of_map = to_rows @ points.calibration_factors(weights)[0]
        return cls(
            points,
            terms,
            to_rows,
            replace(sight, before=before, after=after),
            to_rows @ points.noise_covariance(both) @ to_rows.T,
            np.asarray(of_map @ of_map.T),
            to_rows @ points.still_covariance(both) @ to_rows.T,
        )

    @cached_property
    def noise(self) -> Float:
        """Covariance (24, 24) of the rows by the noise of the images and by smooth errors."""
        of_smooth = self.points.smooth_mm(self.smooth_px) * self.to_rows[:, np.arange(20) % 10 > 0]
        return np.asarray(self.by_images + of_smooth @ of_smooth.T)

    @cached_property
    def errors(self) -> Float:
        """Covariance (20, 20) of the coefficients by all errors."""
        every = self.noise + self.by_calibration + self.still
        return np.asarray(every[COEFFICIENTS, COEFFICIENTS])

    @cached_property
    def whitening(self) -> Float:
        """Matrix W (20, 20) for which W `errors` Wᵀ is the unit matrix."""
        std = np.sqrt(np.diag(self.errors))
        factor = np.linalg.cholesky(self.errors / np.outer(std, std))
        return np.asarray(np.linalg.inv(factor) / std)

    def residual_mm(self, plane: Plane) -> Float:
        """Return the part of the displacements (n, 2) on a plane that the polynomial does not fit."""
        points, centre_mm = self.points, self.sight.centre_mm
        moved_mm = plane.within(points.after_mm, centre_mm) - points.before_mm
        return np.asarray(moved_mm - self.terms @ self.sight.moved(plane)[COEFFICIENTS].reshape(2, 10).T)


def polynomial_terms(position_mm: Float, among_mm: Float | None = None) -> Float:
    """Return the ten terms of a polynomial of third degree at `position_mm` (n, 2), shape (n, 10).

    The terms are 1 at the outermost of the positions `among_mm`. Default: of `position_mm`.
    """
    among_mm = position_mm if among_mm is None else among_mm
    middle_mm = among_mm.mean(axis=0)
    x, y = ((position_mm - middle_mm) / np.abs(among_mm - middle_mm).max()).T
    powers = [(degree - k, k) for degree in range(_DEGREE + 1) for k in range(degree + 1)]
    return np.stack([x**i * y**j for i, j in powers], axis=1)
