"""Strains from displacement gradients, with the standard deviations that the gradients' errors cause.

`dic.strain.measures` has the formulas of the strains.
"""

import numpy as np

from dic.strain.measure_kernel import set_derivative, set_shared_variances, set_variances
from dic.strain.measures import MEASURES
from dic.strain.principal import principal
from dic.typing import Float

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

    `gradient`, shape (…, 2, 2): displacement gradients, ∂u_i/∂x_j at [i, j]. `covariance`, shape (…, 4, 4):
    covariance of the gradient's elements xx, xy, yx, yy; None if it is not known. `measure`: strain measure,
    one of `MEASURES`.

    Returns
    -------
    strain, std : ndarray, shape (6, …)
        Strains and standard deviations in the order of `COMPONENTS`. The direction is the angle from x
        towards y in degrees, in the interval (-90, 90]. If there is no covariance, the standard deviations
        are NaN.
    """
    gradient = np.asarray(gradient, np.float64)
    tensor, by_strain = MEASURES[measure].tensor(gradient)
    strain, axes = _with_principal(tensor)
    if covariance is None:
        return strain, np.full(strain.shape, np.nan)
    count, variance = axes[0].size, np.empty(strain.shape)
    set_variances(
        MEASURES[measure].base,
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

    `tensor`, shape (…, 3): the strains exx, eyy, exy of each point. `covariance`, shape (3, 3): covariance of
    the error of exx, eyy, exy that all points share.
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
    set_derivative(MEASURES[measure].base, np.ascontiguousarray(gradient, np.float64), derivative)
    by_gradient, (_, by_strain) = derivative[:, :3].T, MEASURES[measure].tensor(gradient)
    return np.asarray(by_strain @ by_gradient if by_strain.size else by_gradient)


def limited(std: Float) -> Float:
    """Return `std` (6, …) with the direction's part limited to the value for an unknown direction."""
    return np.concatenate([std[:5], np.minimum(std[5:], _ANY_DIRECTION_DEG)])


def _with_principal(tensor: Float) -> tuple[Float, Float]:
    """Return the six values of `COMPONENTS`, shape (6, …), and their principal axes, shape (3, …).

    The axes are the cosine and the sine of the direction of the larger principal strain, and the difference
    of the principal strains, which is at least `_EQUAL`.
    """
    (e1, e2, angle), difference = principal(tensor)
    strain = np.stack([tensor[..., 0], tensor[..., 1], tensor[..., 2], e1, e2, np.degrees(angle)])
    return strain, np.stack([np.cos(angle), np.sin(angle), np.maximum(difference, _EQUAL)])
