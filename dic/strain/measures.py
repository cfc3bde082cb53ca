"""Strains from displacement gradients, with the standard deviations that the gradients' errors cause.

In the formulas G is the displacement gradient, F = I + G is the deformation gradient, and C = FᵀF is the
right Cauchy-Green tensor. A rigid rotation does not change the Green-Lagrange strain (C - I)/2 and the Hencky
strain ½ ln C. The small strain (G + Gᵀ)/2 is accurate only for small rotations. The strain components refer
to the x and y axes of the displacement in the undeformed state.
"""

import numpy as np

from dic.strain.measure_kernel import (
    GREEN,
    SMALL,
    set_derivative,
    set_shared_variances,
    set_variances,
)
from dic.typing import Float

MEASURES = ("green-lagrange", "small", "hencky")

COMPONENTS = ("exx", "eyy", "exy", "e1", "e2", "direction_deg")
"""Names of strain values: three tensor components, two principal strains, and a direction.

The larger principal strain is e1, and the direction is that of e1, in degrees.
"""

_EQUAL = 1e-12
"""If the two principal strains differ by less than this value, their direction is not determined."""

_ANY_DIRECTION_DEG = 180.0 / np.sqrt(12.0)
"""Largest possible standard deviation of a direction: that of a uniform distribution over 180°."""


def strain_of(gradient: Float, covariance: Float | None, measure: str) -> tuple[Float, Float]:
    """Return strains and their standard deviations, to first order in the errors of the gradients.

    Parameters
    ----------
    gradient : ndarray, shape (…, 2, 2)
        Displacement gradients, ∂u_i/∂x_j at [i, j].
    covariance : ndarray, shape (…, 4, 4), or None
        Covariance of the gradient's elements xx, xy, yx, yy; None if it is not known.
    measure : str
        Strain measure, one of `MEASURES`.

    Returns
    -------
    strain, std : ndarray, shape (6, …)
        Strains and standard deviations in the order of `COMPONENTS`. The direction is the angle from x
        towards y in degrees, in the interval (-90, 90]. If there is no covariance, the standard deviations
        are NaN.
    """
    gradient = np.asarray(gradient, np.float64)
    tensor, by_strain = _tensor(gradient, measure)
    strain, axes = _with_principal(tensor)
    if covariance is None:
        return strain, np.full(strain.shape, np.nan)
    count, variance = axes[0].size, np.empty(strain.shape)
    set_variances(
        _kind(measure),
        np.ascontiguousarray(gradient).reshape(count, 2, 2),
        by_strain.reshape(-1, 3, 3),
        axes.reshape(3, count),
        np.ascontiguousarray(covariance, np.float64).reshape(count, 4, 4),
        np.empty((2, 4, 6)),
        variance.reshape(6, count),
    )
    std = np.sqrt(np.maximum(variance, 0.0))
    std[5] = np.fmin(np.degrees(std[5]), _ANY_DIRECTION_DEG)
    # Where the strain is NaN, this sum makes the standard deviation NaN as well.
    return strain, std + 0.0 * strain


def shared_std(tensor: Float, covariance: Float) -> Float:
    """Return the standard deviations that an error common to all points causes, shape (6, …).

    Parameters
    ----------
    tensor : ndarray, shape (…, 3)
        The strains exx, eyy, exy of each point.
    covariance : ndarray, shape (3, 3)
        Covariance of the error of exx, eyy, exy that all points share.
    """
    strain, axes = _with_principal(tensor)
    variance = np.empty(strain.shape)
    count, covariance = axes[0].size, np.ascontiguousarray(covariance, np.float64)
    set_shared_variances(axes.reshape(3, count), covariance, np.empty((3, 6)), variance.reshape(6, count))
    std = np.sqrt(np.maximum(variance, 0.0))
    std[5] = np.degrees(std[5])
    return np.asarray(std)


def strain_covariance(gradient: Float, covariance: Float, measure: str) -> Float:
    """Return the covariance (3, 3) of exx, eyy, exy from the covariance (4, 4) of a gradient (2, 2)."""
    by_gradient = strain_by_gradient(gradient, measure)
    return np.asarray(by_gradient @ covariance @ by_gradient.T)


def strain_by_gradient(gradient: Float, measure: str) -> Float:
    """Return the derivatives (3, 4) of exx, eyy, exy with respect to the elements of a gradient (2, 2)."""
    derivative = np.empty((4, 6))
    set_derivative(_kind(measure), np.ascontiguousarray(gradient, np.float64), derivative)
    by_gradient, (_, by_strain) = derivative[:, :3].T, _tensor(gradient, measure)
    return np.asarray(by_strain @ by_gradient if by_strain.size else by_gradient)


def limited(std: Float) -> Float:
    """Return `std` (6, …) with the direction's part limited to the value for an unknown direction."""
    return np.concatenate([std[:5], np.minimum(std[5:], _ANY_DIRECTION_DEG)])


def _kind(measure: str) -> int:
    """Return the strain whose derivatives the compiled functions take for a strain measure."""
    return SMALL if measure == "small" else GREEN


def _tensor(gradient: Float, measure: str) -> tuple[Float, Float]:
    """Return the strains exx, eyy, exy, shape (…, 3), and their derivatives for a further measure.

    The Hencky strain is computed from the Green-Lagrange strain. The derivatives with respect to the
    Green-Lagrange strain have the shape (…, 3, 3). For other measures they have the shape (0, 3, 3).
    """
    gxx, gxy, gyx, gyy = (gradient[..., i, j] for i in (0, 1) for j in (0, 1))
    if measure == "small":
        return np.stack([gxx, gyy, (gxy + gyx) / 2], axis=-1), np.empty((0, 3, 3))
    fxx, fyy = 1.0 + gxx, 1.0 + gyy
    green = np.stack(
        [
            (fxx * fxx + gyx * gyx) / 2 - 0.5,
            (gxy * gxy + fyy * fyy) / 2 - 0.5,
            (fxx * gxy + gyx * fyy) / 2,
        ],
        axis=-1,
    )
    return _hencky(green) if measure == "hencky" else (green, np.empty((0, 3, 3)))


def _hencky(green: Float) -> tuple[Float, Float]:
    """Return the Hencky strains (…, 3) that belong to Green-Lagrange strains (…, 3), and their derivatives.

    The derivatives, shape (…, 3, 3), are with respect to the Green-Lagrange strains. Both strain tensors have
    the same principal axes. In these axes, the derivative of a function of a symmetric tensor consists of
    divided differences of the function (G. H. Golub, C. F. Van Loan, Matrix Computations, 9.1.4).
    """
    (e1, e2, angle), _ = _principal(green)
    # The logarithm of a stretch of 0 does not exist; the strain is NaN there.
    stretched = 1.0 + 2.0 * np.stack([e1, e2])
    l1, l2 = np.where(stretched > 0.0, stretched, np.nan)
    h1, h2 = 0.5 * np.log(l1), 0.5 * np.log(l2)
    apart = l1 - l2 > 1e-9 * l1
    shear = np.where(apart, 2.0 * (h1 - h2) / np.where(apart, l1 - l2, 1.0), 1.0 / l1)
    into = _turned(angle)
    diagonal = np.zeros((*np.shape(e1), 3, 3))
    diagonal[..., 0, 0], diagonal[..., 1, 1], diagonal[..., 2, 2] = 1.0 / l1, 1.0 / l2, shear
    back = _turned(-angle)
    principal = np.stack([h1, h2, np.zeros_like(h1)], axis=-1)
    return (back @ principal[..., None])[..., 0], back @ diagonal @ into


def _turned(angle: Float) -> Float:
    """Return the matrices (…, 3, 3) that transform exx, eyy and exy to axes rotated by `angle`, radians."""
    c, s = np.cos(angle), np.sin(angle)
    rows = [[c * c, s * s, 2 * c * s], [s * s, c * c, -2 * c * s], [-c * s, c * s, c * c - s * s]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def _principal(tensor: Float) -> tuple[tuple[Float, Float, Float], Float]:
    """Return a tuple (larger principal strain, smaller one, direction of the larger), and their difference.

    The direction is in radians.
    """
    xx, yy, xy = tensor[..., 0], tensor[..., 1], tensor[..., 2]
    middle, radius = (xx + yy) / 2, np.hypot((xx - yy) / 2, xy)
    return (middle + radius, middle - radius, np.arctan2(xy, (xx - yy) / 2) / 2), 2 * radius


def _with_principal(tensor: Float) -> tuple[Float, Float]:
    """Return the six values of `COMPONENTS`, shape (6, …), and their principal axes, shape (3, …).

    The axes are the cosine and the sine of the direction of the larger principal strain, and the difference
    of the principal strains, which is at least `_EQUAL`.
    """
    (e1, e2, angle), difference = _principal(tensor)
    strain = np.stack([tensor[..., 0], tensor[..., 1], tensor[..., 2], e1, e2, np.degrees(angle)])
    return strain, np.stack([np.cos(angle), np.sin(angle), np.maximum(difference, _EQUAL)])
