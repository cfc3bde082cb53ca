"""Standard deviations of a warp, from the residuals of its subset and the Hessian.

docs/kernel.md derives the standard deviations and explains their corrections.
"""

import math

import numpy as np

from dic.correlation.kernel.jit import inner
from dic.correlation.kernel.layout import Flat
from dic.correlation.kernel.method import Method, Subset
from dic.correlation.kernel.records import FX_FX, NORM2
from dic.typing import Float

_WIDEST = 5.0
"""Largest factor by which the correction for noise in the gradients increases standard deviations."""


@inner
def write_std(
    record: Flat, L: Float, method: Method, subset: Subset, p: Float, zncc: float, y: Float, std: Float
) -> None:
    """Write the standard deviations of the first six warp parameters into `std`.

    The standard deviations are the square roots of the diagonal of 2σ² (L L')⁻¹, where σ² is the variance of
    the noise and L the Cholesky factor of the Hessian. Noise in the reference's derivatives fx and fy
    increases ∑fx² and ∑fy². So the Hessian shows more texture than there is, and the standard deviations are
    too small. This function multiplies the standard deviations by the ratio of each sum to its value without
    noise, but at most by `_WIDEST`. Residuals that give a larger ratio come from a change of light or paint,
    not from noise. `y` is scratch memory.
    """
    residual2 = 2.0 * record[NORM2] * max(0.0, 1.0 - zncc)
    variance = _noise_variance(residual2, subset.pixels, p, subset.radius, method.noise_gain)
    slope_noise = variance / 2.0 * method.slope_noise_gain
    for k in range(6):
        # Element (k, k) of the inverse is the squared length of the k-th column of L⁻¹.
        square = 0.0
        for i in range(k, len(y)):
            s = 1.0 if i == k else 0.0
            for j in range(k, i):
                s -= L[i, j] * y[j]
            y[i] = s / L[i, i]
            square += y[i] * y[i]
        apparent = record[FX_FX + k // 3]
        texture = max(apparent - subset.pixels * slope_noise, apparent / _WIDEST)
        std[k] = math.sqrt(variance * square) * (apparent / texture)


@inner
def _noise_variance(residual2: float, n: int, p: Float, r: int, noise_gain: float) -> float:
    """Return twice the variance of the images' noise, from the squared residuals of a subset of n pixels.

    Both images have noise. In the residuals, interpolation between pixels reduces the noise of the deformed
    image. Half-way between pixels, the variance is multiplied by the factor `noise_gain`. At other positions
    the factor varies as the cosine of the sub-pixel position. Interpolation does not reduce the effect of the
    noise on displacements. The factor of the reference image is 1, because this image is not interpolated. So
    this function divides the variance of the residuals by the mean of both images' factors.
    """
    damping = 1.0
    for at in (0, 3):
        # A displacement gradient gives the pixels different sub-pixel positions, so take the mean of their
        # cosines.
        swing = math.cos(2.0 * np.pi * p[at]) * _sinc(2.0 * r * p[at + 1]) * _sinc(2.0 * r * p[at + 2])
        damping *= (1.0 + noise_gain + (1.0 - noise_gain) * swing) / 2.0
    return 2.0 * residual2 / (n - len(p) - 2) / (1.0 + damping)


@inner
def _sinc(x: float) -> float:
    """Return sin(πx) / (πx), which is 1 at x = 0."""
    return math.sin(np.pi * x) / (np.pi * x) if x != 0.0 else 1.0
