"""Solve the slopes of a specimen's plane from the displacement field that one camera measures.

A tilt with the slopes a, b causes an apparent displacement. The linear part of this apparent displacement
looks like strain. The quadratic part of the apparent displacement is (a x² + b x y, a x y + b y²)/Cz, where
Cz is the height of the camera's centre. Uniform strain has no quadratic part. Bending of the specimen within
the plane has the quadratic part (-(y² + ν x²)/2, x y) κ, where κ is the curvature and ν is Poisson's ratio.
If the specimen bends in the direction of the other axis, x and y are exchanged. So bending can be
distinguished from a tilt. The slopes are solved such that the points on the sloped plane move only by affine
motion and bending.
"""

from dataclasses import dataclass

import numpy as np

from dic.out_of_plane.plane import Plane
from dic.out_of_plane.uncertainty import Points
from dic.typing import Float

_STEPS = 8
_CLOSE = 1e-9
"""The iteration ends when the slopes change by less than this, which is less than 1e-3 µε of strain."""

_SMALL = 1e-6
"""Step of the slope for numerical derivatives."""

_MIMICKED = 0.1
"""A polynomial term of the remainder is dropped if less than this fraction is independent of the fit."""


@dataclass(frozen=True)
class TiltFit:
    """The slopes of the specimen's plane that explain one displacement field best, and the residuals.

    Attributes
    ----------
    plane : Plane
        Plane of the specimen's surface in the deformed image, relative to the surface in the reference.
    slope_weights : ndarray, shape (n, 2, 2)
        Weights with which the displacements on the sloped plane enter the two slopes (last axis).
    by_slope : ndarray, shape (n, 2, 2)
        Derivative of the points' positions on the plane with respect to the two slopes (last axis).
    residual_mm : ndarray, shape (n, 2)
        Displacement that affine motion, bending and tilt do not explain.
    remainder_mm : ndarray, shape (n, 2)
        The smooth part of the residual ("remainder"), which consists of polynomials of second and third
        degree.
    remainder_weights : ndarray, shape (n, 2, 14)
        Weights with which the residual enters the 14 coefficients of the remainder.
    terms : ndarray, shape (n, 2, 14)
        The 14 polynomial terms of the remainder at the points.
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
        """Root mean square length of `remainder_mm`."""
        return float(np.sqrt((self.remainder_mm**2).sum(axis=1).mean()))


def fit_tilt(points: Points, centre_mm: Float, poisson_ratio: float) -> TiltFit:
    """Find the slopes of the plane within which the specimen moves only by affine motion and bending.

    Parameters
    ----------
    points : Points
        The points of the displacement field, at least a few dozen.
    centre_mm : ndarray, shape (3,)
        The camera's centre in the grid's axes.
    poisson_ratio : float
        Poisson's ratio of the specimen, which determines the shape of a bent specimen.
    """
    shape = _Basis.of(points.before_mm, poisson_ratio)
    plane = _solve(points, centre_mm, shape, Plane())
    after = points.after_mm
    moved = plane.within(after, centre_mm) - points.before_mm
    by_slope = _by_slope(after, centre_mm, plane)
    design = _design(shape, by_slope)
    inverse = np.linalg.solve(design.T @ design, design.T)
    residual = (moved.ravel() - design @ (inverse @ moved.ravel())).reshape(-1, 2)
    # Make the terms of the remainder orthogonal to affine motion, bending and tilt.
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
    """Return only the plane that `fit_tilt` finds; `start` is a plane close to the solution."""
    return _solve(points, centre_mm, _Basis.of(points.before_mm, poisson_ratio), start)


def _solve(points: Points, centre_mm: Float, shape: "_Basis", plane: Plane) -> Plane:
    """Find the plane by Gauss-Newton steps, which also solve the affine motion and the bending."""
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
    """Return the design matrix of affine motion, bending and both slopes, shape (2 n, 10)."""
    return np.asarray(np.concatenate([shape.uniform, -by_slope], axis=2).reshape(2 * len(by_slope), -1))


def _by_slope(after: Float, centre_mm: Float, plane: Plane) -> Float:
    """Return the derivative of the points' positions on the plane by its two slopes, shape (n, 2, 2)."""
    here, sides = plane.within(after, centre_mm), []
    for dx, dy in ((_SMALL, 0.0), (0.0, _SMALL)):
        ahead = Plane(plane.slope_x + dx, plane.slope_y + dy).within(after, centre_mm)
        sides.append((ahead - here) / _SMALL)
    return np.stack(sides, axis=-1)


@dataclass(frozen=True)
class _Basis:
    """Basis functions of displacement fields at n points.

    `uniform` holds affine motion and bending, shape (n, 2, 8). `remainder` holds all polynomials of second
    and third degree, shape (n, 2, 14).
    """

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
