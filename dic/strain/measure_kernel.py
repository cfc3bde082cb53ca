"""The standard deviations of strains, compiled: they follow from the covariances of displacement gradients.

`dic.strain.measures` defines the strains. All sums have the order of terms in which they are written here.
"""

from dic.correlation.kernel.jit import compiled, inner
from dic.typing import Float

GREEN, SMALL = 0, 1
"""Strains whose derivatives `set_variances` takes: Green-Lagrange strain, small strain."""


@compiled
def set_variances(
    kind: int, gradient: Float, by_strain: Float, axes: Float, covariance: Float, work: Float, variance: Float
) -> None:
    """Set the variances of the six values of `dic.strain.tensor.COMPONENTS` at each point.

    Parameters
    ----------
    kind : int
        `GREEN` or `SMALL`.
    gradient : ndarray, shape (n, 2, 2)
        Displacement gradients.
    by_strain : ndarray, shape (n, 3, 3) or (0, 3, 3)
        Derivatives of exx, eyy, exy with respect to the components of the strain `kind`. The array has no
        elements if these strains are the same.
    axes : ndarray, shape (3, n)
        Cosine and sine of the direction of the larger principal strain, and the difference of the principal
        strains.
    covariance : ndarray, shape (n, 4, 4)
        Covariance of the elements of the displacement gradient.
    work : ndarray, shape (2, 4, 6)
        Work array.
    variance : ndarray, shape (6, n)
        Output. The variance of the direction is in square radians.
    """
    own, derivative = work[1], work[0]
    for n in range(gradient.shape[0]):
        set_derivative(kind, gradient[n], derivative)
        if by_strain.shape[0]:
            for i in range(4):
                for m in range(3):
                    own[i, m] = derivative[i, m]
                for k in range(3):
                    total = 0.0
                    for m in range(3):
                        total += by_strain[n, k, m] * own[i, m]
                    derivative[i, k] = total
        _along_axes(axes[0, n], axes[1, n], axes[2, n], derivative)
        for k in range(6):
            own[0, k] = 0.0
        for i in range(4):
            for j in range(4):
                for k in range(6):
                    own[0, k] += derivative[i, k] * covariance[n, i, j] * derivative[j, k]
        for k in range(6):
            variance[k, n] = own[0, k]


@compiled
def set_shared_variances(axes: Float, covariance: Float, derivative: Float, variance: Float) -> None:
    """Set the variances that an error of exx, eyy, exy causes which all points share.

    `axes`, `variance`: as for `set_variances`. `covariance`, shape (3, 3): covariance of the error of exx,
    eyy, exy. `derivative`, shape (3, 6): work array.
    """
    derivative[:] = 0.0
    for k in range(3):
        derivative[k, k] = 1.0
    for n in range(axes.shape[1]):
        _along_axes(axes[0, n], axes[1, n], axes[2, n], derivative)
        for k in range(6):
            total = 0.0
            for i in range(3):
                for j in range(3):
                    total += derivative[i, k] * covariance[i, j] * derivative[j, k]
            variance[k, n] = total


@compiled
def set_derivative(kind: int, gradient: Float, derivative: Float) -> None:
    """Set the derivatives of exx, eyy, exy with respect to the elements of the displacement gradient.

    `kind`: `GREEN` or `SMALL`. `derivative`, shape (4, 6): output, in its first three columns. `gradient` has
    the shape (2, 2).
    """
    stretch = 1.0 if kind == GREEN else 0.0
    fxx, fxy = 1.0 + stretch * gradient[0, 0], stretch * gradient[0, 1]
    fyx, fyy = stretch * gradient[1, 0], 1.0 + stretch * gradient[1, 1]
    derivative[0, 0], derivative[1, 0], derivative[2, 0], derivative[3, 0] = fxx, 0.0, fyx, 0.0
    derivative[0, 1], derivative[1, 1], derivative[2, 1], derivative[3, 1] = 0.0, fxy, 0.0, fyy
    derivative[0, 2], derivative[1, 2] = fxy / 2, fxx / 2
    derivative[2, 2], derivative[3, 2] = fyy / 2, fyx / 2


@inner
def _along_axes(c: float, s: float, difference: float, derivative: Float) -> None:
    """Set the derivatives of the principal strains and of their direction from those of exx, eyy, exy.

    A shear error relative to the principal axes rotates these axes. The smaller the difference of the
    principal strains, the larger the rotation.
    """
    for i in range(derivative.shape[0]):
        xx, yy, xy = derivative[i, 0], derivative[i, 1], derivative[i, 2]
        derivative[i, 3] = c * c * xx + s * s * yy + 2 * c * s * xy
        derivative[i, 4] = s * s * xx + c * c * yy - 2 * c * s * xy
        derivative[i, 5] = (-c * s * xx + c * s * yy + (c * c - s * s) * xy) / difference
