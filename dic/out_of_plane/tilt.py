"""Slopes of a specimen's plane from one camera's view of a displacement field, by their projective signature.

The linear part of the displacement by a tilt looks like strain. Its quadratic part, (a x² + b x y, a x y + b
y²)/Cz, does not: uniform strain has no quadratic part. Bending within the plane is quadratic too, (-(y² + ν
x²)/2, x y) κ and the same with the axes exchanged, but has another shape. The solved slopes are those for
which the points, placed on the sloped plane, move by an affine motion and bending.
"""

from dataclasses import dataclass

import numpy as np

from dic.out_of_plane.plane import Plane
from dic.out_of_plane.uncertainty import Points
from dic.typing import Float

_STEPS = 8
_CLOSE = 1e-9
"""Step of the slopes at which the iteration ends; 1e-9 changes strain by less than 1e-3 µε."""

_SMALL = 1e-6
"""Step of the slope for numerical derivatives."""

_MIMICKED = 0.1
"""A term of the remainder is dropped if less than this fraction of the term is independent of the fit."""


@dataclass(frozen=True)
class TiltFit:
    """The slopes that explain one displacement field best.

    Attributes
    ----------
    plane : Plane
        Plane of the surface in the deformed image, relative to the reference.
    slope_weights : ndarray, shape (n, 2, 2)
        Weights of displacement errors, on the sloped plane, in the two slopes.
    by_slope : ndarray, shape (n, 2, 2)
        Derivative of the positions on the plane by the slopes (last axis).
    residual_mm : ndarray, shape (n, 2)
        Displacement that affine motion, bending and tilt do not explain.
    remainder_mm : ndarray, shape (n, 2)
        The part of the residual that is a polynomial of second and third degree.
    remainder_weights : ndarray, shape (n, 2, 14)
        Weights of the residual in the remainder's coefficients.
    terms : ndarray, shape (n, 2, 14)
        The remainder's terms.
    """

    plane: Plane
    slope_weights: Float
    by_slope: Float
    residual_mm: Float
    remainder_mm: Float
    remainder_weights: Float
    terms: Float

    @property
    def remainder_rms_mm(self) -> float:
        """Root mean square length of the remainder."""
        return float(np.sqrt((self.remainder_mm**2).sum(axis=1).mean()))


def fit_tilt(points: Points, centre_mm: Float, poisson_ratio: float) -> TiltFit:
    """Find the slopes for which the field is affine motion and bending within the specimen's plane.

    Parameters
    ----------
    points : Points
        At least some dozens of points.
    centre_mm : ndarray, shape (3,)
        The camera's centre in the grid's axes.
    poisson_ratio : float
        Poisson's ratio of the specimen, for the shape of its bending.
    """
    shape = _Basis.of(points.before_mm, poisson_ratio)
    plane = _solve(points, centre_mm, shape, Plane())
    after = points.after_mm
    moved = plane.within(after, centre_mm) - points.before_mm
    by_slope = _by_slope(after, centre_mm, plane)
    design = _design(shape, by_slope)
    inverse = np.linalg.solve(design.T @ design, design.T)
    residual = (moved.ravel() - design @ (inverse @ moved.ravel())).reshape(-1, 2)
    # The remainder's terms, made orthogonal to affine motion, bending and tilt.
    terms = shape.remainder.reshape(2 * len(after), -1)
    terms = terms - design @ (inverse @ terms)
    weights = np.linalg.pinv(terms, rcond=_MIMICKED)
    remainder = terms @ (weights @ residual.ravel())
    n = len(after)
    return TiltFit(
        plane,
        np.asarray(inverse[-2:].T.reshape(n, 2, 2)),
        by_slope,
        residual,
        remainder.reshape(n, 2),
        np.asarray(weights.T.reshape(n, 2, -1)),
        terms.reshape(n, 2, -1),
    )


def tilt_seen_from(points: Points, centre_mm: Float, poisson_ratio: float, start: Plane) -> Plane:
    """Return only the plane that `fit_tilt` finds, starting from a plane close to it."""
    return _solve(points, centre_mm, _Basis.of(points.before_mm, poisson_ratio), start)


def _solve(points: Points, centre_mm: Float, shape: "_Basis", plane: Plane) -> Plane:
    """Find the plane by Gauss-Newton; affine motion and bending are linear and solved in each step."""
    after = points.after_mm
    for _ in range(_STEPS):
        moved = plane.within(after, centre_mm) - points.before_mm
        design = _design(shape, _by_slope(after, centre_mm, plane))
        step = np.linalg.solve(design.T @ design, design.T @ moved.ravel())[-2:]
        plane = Plane(plane.slope_x + step[0], plane.slope_y + step[1])
        if np.abs(step).max() < _CLOSE:
            break
    return plane


def _design(shape: "_Basis", by_slope: Float) -> Float:
    """Return the design matrix of affine motion, bending and slopes, (2 n, 10)."""
    return np.asarray(np.concatenate([shape.uniform, -by_slope], axis=2).reshape(2 * len(by_slope), -1))


def _by_slope(after: Float, centre_mm: Float, plane: Plane) -> Float:
    """Return the derivative of the positions on the plane by both slopes, (n, 2, 2)."""
    here, sides = plane.within(after, centre_mm), []
    for dx, dy in ((_SMALL, 0.0), (0.0, _SMALL)):
        ahead = Plane(plane.slope_x + dx, plane.slope_y + dy).within(after, centre_mm)
        sides.append((ahead - here) / _SMALL)
    return np.stack(sides, axis=-1)


@dataclass(frozen=True)
class _Basis:
    """Basis of displacement fields: affine motion and bending, (n, 2, 8), other polynomials to degree 3."""

    uniform: Float
    remainder: Float

    @classmethod
    def of(cls, position_mm: Float, poisson_ratio: float) -> "_Basis":
        centred = position_mm - position_mm.mean(axis=0)
        x, y = (centred / np.abs(centred).max()).T
        one, none, nu = np.ones_like(x), np.zeros_like(x), poisson_ratio
        affine = [(t, none) for t in (one, x, y)] + [(none, t) for t in (one, x, y)]
        bending = [(-(y * y + nu * x * x) / 2, x * y), (x * y, -(x * x + nu * y * y) / 2)]
        others = (x * x, x * y, y * y, x**3, x * x * y, x * y * y, y**3)
        remainder = [(t, none) for t in others] + [(none, t) for t in others]
        return cls(*(np.array(fields).transpose(2, 1, 0) for fields in (affine + bending, remainder)))
