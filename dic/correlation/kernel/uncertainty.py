"""Standard deviations of a warp, from the residuals of its subset and the Hessian.

docs/kernel.md derives them and says what the corrections are for.
"""

import math

import numpy as np

from dic.correlation.kernel.jit import inner
from dic.correlation.kernel.layout import Flat
from dic.correlation.kernel.method import Method, Subset
from dic.correlation.kernel.prepared import FX_FX, NORM2
from dic.typing import Float

_WIDEST = 5.0
"""Standard deviations are widened at most by this factor."""


@inner
def write_std(
    record: Flat, L: Float, method: Method, subset: Subset, p: Float, zncc: float, y: Float, std: Float
) -> None:
    """Write the standard deviations of the first six parameters: roots of the diagonal of 2σ² (L L')⁻¹.

    Noise in the slopes of the reference, too, raises ∑fx² and ∑fy². The Hessian then shows more texture than
    there is, and standard deviations come out too small by the ratio of apparent to true sum. The ratio is
    limited to `_WIDEST`: residuals that ask for more are not noise, but light or paint that changed. `y` is
    memory to work in.
    """
    residual2 = 2.0 * record[NORM2] * max(0.0, 1.0 - zncc)
    variance = _noise_variance(residual2, subset.pixels, p, subset.radius, method.noise_gain)
    slope_noise = variance / 2.0 * method.slope_noise_gain
    for k in range(6):
        # Element (k, k) of the inverse: the squared length of the k-th column of L⁻¹.
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

    Both images have noise. Interpolation between pixels damps that of the deformed image in the residuals:
    its variance to `noise_gain` half-way, in between by the cosine of the position. It does not damp the
    effect of the noise on displacements, so the damping is undone.
    """
    damping = 1.0
    for at in (0, 3):
        # With a displacement gradient the subset's pixels have several sub-pixel positions: mean cosine.
        swing = math.cos(2.0 * np.pi * p[at]) * _sinc(2.0 * r * p[at + 1]) * _sinc(2.0 * r * p[at + 2])
        damping *= (1.0 + noise_gain + (1.0 - noise_gain) * swing) / 2.0
    return 2.0 * residual2 / (n - len(p) - 2) / (1.0 + damping)


@inner
def _sinc(x: float) -> float:
    """Return sin(πx) / (πx)."""
    return math.sin(np.pi * x) / (np.pi * x) if x != 0.0 else 1.0
