"""Lens distortion on the sensor: conversion from ideal to distorted image points, and back.

An ideal point is the image point of a pinhole camera without distortion. Radial and decentring distortion
follow Brown, *Close-range camera calibration* (1971), with coefficients in the usual order k1, k2, p1, p2.
All coordinates are in px from the principal point, so the coefficients do not depend on the focal length. The
units are px⁻² for k1, px⁻⁴ for k2, and px⁻¹ for p1 and p2. A positive k1 means pincushion distortion, and a
negative k1 means barrel distortion.

A lens whose images ask for it has more terms: k3 in px⁻⁶, and then a remainder, the smooth distortion that
these do not describe. The remainder is a polynomial in x and y: for each of `monomials`, in their order, the
coefficient of its shift along x, and of its shift along y.
"""

from functools import lru_cache

import numpy as np
from numpy.polynomial.polynomial import polyder, polyval2d

from dic.typing import Float, Mask

_MOST_STEPS = 50
_EXACT_PX = 1e-10
_FIRST = 4
"""Number of the coefficients k1, k2, p1 and p2, which every lens has."""


def monomials(degree: int) -> list[tuple[int, int]]:
    """Return the powers of x and y in the polynomial of a remainder of this degree; it begins at 2."""
    return [(total - j, j) for total in range(2, degree + 1) for j in range(total + 1)]


def powers(count: int) -> Float:
    """Return the power of px⁻¹ in the unit of each of `count` distortion coefficients."""
    of_rest = [i + j - 1 for i, j in _rest(count) for _ in "xy"]
    return np.array([2, 4, 1, 1, 6, *of_rest][:count])


def distortion_basis(ideal_px: Float, count: int = _FIRST) -> Float:
    """Return the shift of ideal points (n, 2) per unit of `count` coefficients, shape (n, 2, count)."""
    x, y = ideal_px[:, 0], ideal_px[:, 1]
    square = x * x + y * y
    fourth, across = square * square, 2 * x * y
    sixth, nothing = fourth * square, np.zeros_like(x)
    along_x = [x * square, x * fourth, across, square + 2 * x * x, x * sixth]
    along_y = [y * square, y * fourth, square + 2 * y * y, across, y * sixth]
    for i, j in _rest(count):
        term = x**i * y**j
        along_x += [term, nothing]
        along_y += [nothing, term]
    return np.ascontiguousarray(np.moveaxis(np.array([along_x[:count], along_y[:count]]), 2, 0))


def distort(ideal_px: Float, distortion: Float) -> Float:
    """Return the distorted points (n, 2), px, that belong to ideal points (n, 2).

    `ideal_px`, shape (n, 2): coordinates from the principal point, px. `distortion`, shape (4,) or more: the
    distortion coefficients k1, k2, p1, p2 and k3, and those of the remainder.
    """
    count = min(len(distortion), _FIRST + 1)
    moved: Float = ideal_px + distortion_basis(ideal_px, count) @ distortion[:count]
    if len(distortion) > count:
        moved += polyval2d(ideal_px[:, 0], ideal_px[:, 1], _polynomial(distortion)).T
    return moved


def distortion_jacobian(ideal_px: Float, distortion: Float) -> Float:
    """Return the Jacobian of the map from ideal to distorted points, at ideal points (n, 2), (n, 2, 2)."""
    k1, k2, p1, p2 = distortion[:_FIRST]
    k3 = distortion[_FIRST] if len(distortion) > _FIRST else 0.0
    x, y = ideal_px[:, 0], ideal_px[:, 1]
    square = x * x + y * y
    radial = 1 + k1 * square + k2 * square**2 + k3 * square**3
    # The slope is twice the derivative of the radial factor with respect to the squared radius.
    slope = 2 * (k1 + 2 * k2 * square + 3 * k3 * square**2)
    across = slope * x * y + 2 * (p1 * x + p2 * y)
    jacobian = np.empty((len(x), 2, 2))
    jacobian[:, 0, 0] = radial + slope * x * x + 2 * p1 * y + 6 * p2 * x
    jacobian[:, 0, 1] = jacobian[:, 1, 0] = across
    jacobian[:, 1, 1] = radial + slope * y * y + 6 * p1 * y + 2 * p2 * x
    if len(distortion) > _FIRST + 1:
        terms = _polynomial(distortion)
        for axis in (0, 1):
            jacobian[:, :, axis] += polyval2d(x, y, polyder(terms, axis=axis)).T
    return jacobian


def undistort(distorted_px: Float, distortion: Float) -> Float:
    """Return the ideal points (n, 2), px, of distorted points (n, 2), or NaN if there is no ideal point.

    Newton's method starts from the distorted point. Barrel distortion has a largest distorted radius; points
    beyond this radius give NaN. Solutions where the distortion folds the image over also give NaN.
    """
    ideal = np.array(distorted_px, np.float64)
    if not np.any(distortion):
        return ideal
    with np.errstate(all="ignore"):
        for _ in range(_MOST_STEPS):
            off = distort(ideal, distortion) - distorted_px
            step = _solved(distortion_jacobian(ideal, distortion), off)
            ideal -= step
            if not np.any(np.abs(step) > _EXACT_PX):
                break
        off_px = np.abs(distort(ideal, distortion) - distorted_px).max(axis=1)
        lost = ~(off_px < 1e-6) | folded(ideal, distortion)
    ideal[lost] = np.nan
    return ideal


def folded(ideal_px: Float, distortion: Float) -> Mask:
    """Return True where the distortion reverses the image around an ideal point (n, 2); False for NaN."""
    jacobian = distortion_jacobian(ideal_px, distortion)
    determinant = jacobian[:, 0, 0] * jacobian[:, 1, 1] - jacobian[:, 0, 1] * jacobian[:, 1, 0]
    # After two folds the determinant is positive again, but the image is reversed in both directions.
    reversed_: Mask = (determinant <= 0) | (jacobian[:, 0, 0] + jacobian[:, 1, 1] <= 0)
    return reversed_


def _polynomial(distortion: Float) -> Float:
    """Return the coefficients of the remainder for `polyval2d`: power of x, power of y, axis of the shift."""
    rest = _rest(len(distortion))
    degree = sum(rest[-1])
    terms = np.zeros((degree + 1, degree + 1, 2))
    i, j = np.array(rest).T
    terms[i, j] = distortion[_FIRST + 1 :].reshape(-1, 2)
    return terms


@lru_cache(maxsize=16)
def _rest(count: int) -> list[tuple[int, int]]:
    """Return the monomials of the remainder of a lens with `count` coefficients."""
    degree = 1
    while 2 * len(monomials(degree)) < count - _FIRST - 1:
        degree += 1
    return monomials(degree)


def _solved(matrices: Float, vectors: Float) -> Float:
    """Solve n systems of two linear equations, shape (n, 2); a singular matrix gives infinity or NaN."""
    a, b, c, d = (matrices[:, i, j] for i in (0, 1) for j in (0, 1))
    determinant = a * d - b * c
    x, y = vectors[:, 0], vectors[:, 1]
    return np.stack([(d * x - b * y) / determinant, (a * y - c * x) / determinant], axis=1)
