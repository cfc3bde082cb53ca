"""Strain in one direction: its variance, and the engineering strain of a displacement gradient."""

import numpy as np

from dic.typing import Float


def along(covariance: Float, direction: Float) -> float:
    """Return the variance of the strain along a unit vector (2,) from the covariance (3, 3) of the strains.

    The strain along the unit vector (c, s) is c² exx + s² eyy + 2 c s exy.
    """
    c, s = direction
    weights = np.array([c * c, s * s, 2.0 * c * s])
    # A component with the weight 0 may have an unknown error, NaN.
    used = weights != 0.0
    return float(weights[used] @ covariance[np.ix_(used, used)] @ weights[used])


def engineering(stretch: float, measure: str) -> float:
    """Return the derivative of engineering strain with respect to another measure of strain, at a stretch λ.

    The Green-Lagrange strain is (λ² - 1)/2, the Hencky strain is ln λ.
    """
    return {"green-lagrange": 1.0 / stretch, "hencky": stretch, "small": 1.0}[measure]


def elongation(gradient: Float, direction: Float) -> tuple[float, Float]:
    """Return the engineering strain along a unit vector (2,), and its derivatives (4,).

    Parameters
    ----------
    gradient : ndarray, shape (2, 2)
        Displacement gradient, ∂u_i/∂x_j at [i, j]. The derivatives are with respect to its elements xx, xy,
        yx, yy.
    direction : ndarray, shape (2,)
    """
    turned = direction + gradient @ direction
    stretch = float(np.linalg.norm(turned))
    return stretch - 1.0, np.outer(turned / stretch, direction).ravel()
