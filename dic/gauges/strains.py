"""Strain in one direction: its variance, and the engineering strain of a displacement gradient."""

import numpy as np

from dic.typing import Float


def along(covariance: Float, direction: Float) -> float:
    """Return the variance of the strain along a unit vector (2,), from the covariance of exx, eyy, exy.

    The strain along the unit vector (c, s) is c² exx + s² eyy + 2 c s exy.
    """
    weights = along_weights(direction)
    return covariance_along(covariance, weights, weights)


def along_weights(direction: Float) -> Float:
    """Return the weights (3,) of exx, eyy and exy in the strain along a unit vector (2,)."""
    c, s = direction
    return np.array([c * c, s * s, 2.0 * c * s])


def covariance_along(covariance: Float, one: Float, other: Float) -> float:
    """Return the covariance of two weighted sums of exx, eyy, exy, from the covariance of exx, eyy, exy."""
    # A component with the weight 0 may have an unknown error, NaN.
    rows, columns = one != 0.0, other != 0.0
    return float(one[rows] @ covariance[np.ix_(rows, columns)] @ other[columns])


def elongation(gradient: Float, direction: Float) -> tuple[float, Float]:
    """Return the engineering strain along a unit vector (2,), and its derivatives (4,).

    `gradient`, shape (2, 2): displacement gradient, ∂u_i/∂x_j at [i, j]. The derivatives are with respect to
    its elements xx, xy, yx, yy. `direction` has the shape (2,).
    """
    turned = direction + gradient @ direction
    stretch = float(np.linalg.norm(turned))
    return stretch - 1.0, np.outer(turned / stretch, direction).ravel()
