"""Data of the reference's subsets that IC-GN prepares once and uses again for all images of a series.

B. Pan, K. Li, W. Tong, "Fast, robust and accurate digital image correlation calculation without redundant
computations", Experimental Mechanics 53 (2013) 1277-1289. docs/kernel.md derives the Hessian.
"""

import numpy as np

from dic.correlation.kernel import cholesky, sums as m
from dic.correlation.kernel.jit import inner
from dic.correlation.kernel.layout import Flat, KernelReference
from dic.correlation.kernel.method import Shape, Subset
from dic.correlation.kernel.moments import reference_moments
from dic.correlation.kernel.records import FACTORS, FX_FX, FY_FY, MEAN, NORM2
from dic.correlation.kernel.warps import FACTOR, POWER_X, POWER_Y, SIDE, monomial
from dic.correlation.kernel.workspace import Workspace
from dic.typing import Float

_EPSILON = 2.0**-23
"""Relative distance of neighbouring float32 numbers; moments are summed in float32."""


@inner
def prepare(image: KernelReference, shape: Shape, subset: Subset, work: Workspace, record: Flat) -> None:
    """Compute the data that IC-GN needs of a subset of the reference, and write them into `record`."""
    Q, H, s, t = work.Q, work.H, work.s, work.t
    reference_moments(image, shape, subset, Q)
    mean, norm2 = _normal_matrix(Q, subset.pixels, H, s, t)
    flat = max(image.flat_variance * subset.pixels, rounding_share(subset.radius) * Q[m.FF])
    has_texture = norm2 > flat and cholesky.factorise(H)
    record[MEAN], record[NORM2] = mean, norm2 if has_texture else np.nan
    record[FX_FX], record[FY_FY] = Q[m.PRODUCTS], Q[m.PRODUCTS + 30]
    k = FACTORS
    for i in range(len(s)):
        record[k], record[k + 1] = s[i], t[i]
        k += 2
        for j in range(i + 1):
            record[k] = H[i, j]
            k += 1


@inner
def recall(record: Flat, work: Workspace) -> None:
    """Copy the vectors s and t and the Cholesky factor from the record of a point to scratch memory.

    The values of every record are rounded to float32, also those of a new record. So results do not depend on
    whether a record comes from an earlier image.
    """
    H, s, t = work.H, work.s, work.t
    k = FACTORS
    for i in range(len(s)):
        s[i], t[i] = record[k], record[k + 1]
        k += 2
        for j in range(i + 1):
            H[i, j] = record[k]
            k += 1


@inner
def rounding_share(r: int) -> float:
    """Return the relative rounding error of a sum over a subset: one float32 rounding error for each row."""
    return (2 * r + 1) * _EPSILON


@inner
def _normal_matrix(Q: Flat, n: int, H: Float, s: Float, t: Float) -> tuple[float, float]:
    """Compute the Gauss-Newton Hessian of the normalised criterion; return mean and |f̃|² of the subset.

    The computed matrix is H - ss'/n - tt'/|f̃|², where H is the Hessian of IC-GN and n is the number of
    pixels. The vector s is the sum of the steepest-descent vectors of all pixels. For the sum t, the
    steepest-descent vector of each pixel is multiplied by f̃, the pixel's grey level minus the mean. The two
    subtracted terms account for an offset and a gain of the grey levels, which do not change the ZNSSD. The
    right-hand side of the normal equations is the same as with H alone. So the converged warp is also the
    same as with H alone, but fewer iterations are needed.
    """
    mean = Q[m.F] / n
    norm2 = Q[m.FF] - Q[m.F] * mean
    for i in range(len(s)):
        k = monomial(POWER_X[i], POWER_Y[i]) + 6 * SIDE[i]
        s[i] = FACTOR[i] * Q[m.FX + k]
        t[i] = FACTOR[i] * Q[m.FX_F + k] - mean * s[i]
    for i in range(len(s)):
        for j in range(i + 1):
            k = monomial(POWER_X[i] + POWER_X[j], POWER_Y[i] + POWER_Y[j])
            product = Q[m.PRODUCTS + 15 * (SIDE[i] + SIDE[j]) + k]
            H[i, j] = FACTOR[i] * FACTOR[j] * product - s[i] * s[j] / n - t[i] * t[j] / norm2
    return mean, norm2
