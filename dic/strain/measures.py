"""Strain measures of displacement gradients, with the standard deviations that the gradients' errors cause.

G is the displacement gradient, F = I + G the deformation gradient, and C = FᵀF. The measures are
Green-Lagrange (C - I)/2 and Hencky ½ ln C, which do not change with a rigid rotation, and the small strain (G
+ Gᵀ)/2, which holds only for small rotations. The axes are those of the displacement, in the undeformed
state.
"""

import numpy as np

from dic.typing import Float

MEASURES = ("green-lagrange", "small", "hencky")

COMPONENTS = ("exx", "eyy", "exy", "e1", "e2", "direction_deg")
"""Components of the strain tensor, principal strains (the larger first), direction of the larger, degrees."""

_EQUAL = 1e-12
"""If the principal strains differ by less, their direction is not determined."""

_ANY_DIRECTION_DEG = 180.0 / np.sqrt(12.0)
"""Largest standard deviation of a direction: that of a uniform distribution over 180°."""


def strain_of(gradient: Float, covariance: Float | None, measure: str) -> tuple[Float, Float]:
    """Return strains and their standard deviations, to first order in the gradient's errors.

    Parameters
    ----------
    gradient : ndarray, shape (…, 2, 2)
        Displacement gradients, ∂u_i/∂x_j at [i, j].
    covariance : ndarray, shape (…, 4, 4), or None
        Covariance of the gradient's elements xx, xy, yx, yy; None if it is not known.
    measure : str
        One of `MEASURES`.

    Returns
    -------
    strain, std : ndarray, shape (6, …)
        In the order of `COMPONENTS`. The direction is in degrees from x towards y, in (-90, 90]. The standard
        deviations are NaN without a covariance.
    """
    tensor, derivative = _tensor(gradient, measure)
    strain, by_tensor = _with_principal(tensor)
    if covariance is None:
        return strain, np.full(strain.shape, np.nan)
    by_gradient = by_tensor @ derivative
    variance = np.einsum("...ki,...ij,...kj->k...", by_gradient, covariance, by_gradient)
    std = np.sqrt(np.maximum(variance, 0.0))
    std[5] = np.fmin(np.degrees(std[5]), _ANY_DIRECTION_DEG)
    # NaN where the strain is NaN
    return strain, std + 0.0 * strain


def _tensor(gradient: Float, measure: str) -> tuple[Float, Float]:
    """Return (exx, eyy, exy), shape (…, 3), and their derivatives by the gradient, shape (…, 3, 4)."""
    if measure == "small":
        gxx, gxy, gyx, gyy = (gradient[..., i, j] for i in (0, 1) for j in (0, 1))
        symmetric = np.array([[1.0, 0, 0, 0], [0, 0, 0, 1.0], [0, 0.5, 0.5, 0]])
        return np.stack([gxx, gyy, (gxy + gyx) / 2], axis=-1), symmetric
    F = gradient + np.eye(2)
    zero = np.zeros(F.shape[:-2])
    half_C = np.swapaxes(F, -1, -2) @ F / 2
    green = np.stack([half_C[..., 0, 0] - 0.5, half_C[..., 1, 1] - 0.5, half_C[..., 0, 1]], axis=-1)
    derivative = np.stack(
        [
            np.stack([F[..., 0, 0], zero, F[..., 1, 0], zero], axis=-1),
            np.stack([zero, F[..., 0, 1], zero, F[..., 1, 1]], axis=-1),
            np.stack([F[..., 0, 1], F[..., 0, 0], F[..., 1, 1], F[..., 1, 0]], axis=-1) / 2,
        ],
        axis=-2,
    )
    if measure == "green-lagrange":
        return green, derivative
    hencky, by_green = _hencky(green)
    return hencky, by_green @ derivative


def _hencky(green: Float) -> tuple[Float, Float]:
    """Return the Hencky strains (…, 3) of Green-Lagrange strains (…, 3), and their derivatives (…, 3, 3).

    Both tensors have the same principal axes. In these axes the derivative of a function of a symmetric
    tensor consists of the divided differences of the function (G. H. Golub, C. F. Van Loan, Matrix
    Computations, 9.1.4).
    """
    (e1, e2, angle), _ = _principal(green)
    # Where a stretch is 0, its logarithm does not exist: NaN.
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
    """Return the matrices (…, 3, 3) that transform (exx, eyy, exy) to axes rotated by `angle`, radians."""
    c, s = np.cos(angle), np.sin(angle)
    rows = [[c * c, s * s, 2 * c * s], [s * s, c * c, -2 * c * s], [-c * s, c * s, c * c - s * s]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def _principal(tensor: Float) -> tuple[tuple[Float, Float, Float], Float]:
    """Return both principal strains and the direction of the first, radians; and the strains' difference."""
    xx, yy, xy = tensor[..., 0], tensor[..., 1], tensor[..., 2]
    middle, radius = (xx + yy) / 2, np.hypot((xx - yy) / 2, xy)
    return (middle + radius, middle - radius, np.arctan2(xy, (xx - yy) / 2) / 2), 2 * radius


def _with_principal(tensor: Float) -> tuple[Float, Float]:
    """Return the `COMPONENTS`, shape (6, …), and their derivatives by (exx, eyy, exy), shape (…, 6, 3)."""
    (e1, e2, angle), difference = _principal(tensor)
    strain = np.stack([tensor[..., 0], tensor[..., 1], tensor[..., 2], e1, e2, np.degrees(angle)])
    derivative = np.zeros((*np.shape(e1), 6, 3))
    derivative[..., :3, :] = np.eye(3)
    turned = _turned(angle)
    derivative[..., 3:5, :] = turned[..., :2, :]
    # A shear error in the principal axes rotates them, by any angle if both principal strains are equal.
    derivative[..., 5, :] = turned[..., 2, :] / np.maximum(difference, _EQUAL)[..., None]
    return strain, derivative
