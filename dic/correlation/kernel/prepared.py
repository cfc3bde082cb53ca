"""What IC-GN needs of a subset of the reference: prepared once, and kept for all images of a series.

B. Pan, K. Li, W. Tong, "Fast, robust and accurate digital image correlation calculation without redundant
computations", Experimental Mechanics 53 (2013) 1277-1289. docs/kernel.md derives the Hessian.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dic.correlation.kernel import cholesky
from dic.correlation.kernel import moments as m
from dic.correlation.kernel.jit import inner
from dic.correlation.kernel.layout import Flat, Reference
from dic.correlation.kernel.method import Shape, Subset
from dic.correlation.kernel.warps import FACTOR, POWER_X, POWER_Y, SIDE, monomial
from dic.correlation.kernel.workspace import Workspace
from dic.typing import Float

# Places in the record of a point; s, t and the Cholesky factor follow from FACTORS on.
MEAN, NORM2, FX_FX, FY_FY, FACTORS = 0, 1, 2, 3, 4

_EPSILON = 2.0**-23
"""Relative distance of neighbouring float32, in which moments are summed."""


class Prepared(NamedTuple):
    """What IC-GN needs of the subsets of a reference, for those points of a grid where it is known already.

    Attributes
    ----------
    known : ndarray of bool, shape (rows, columns)
    records : ndarray of float32, shape (rows, columns, n)
        Mean of f, |f̃|² (NaN without texture), ∑fx² and ∑fy², then s, t and the Cholesky factor of H.
    """

    known: NDArray[np.bool_]
    records: NDArray[np.float32]

    @classmethod
    def empty(cls, shape: tuple[int, int], parameters: int) -> "Prepared":
        """Return room for the points of a grid. The system provides the memory only as it is filled."""
        return cls(np.zeros(shape, np.bool_), np.empty((*shape, record_length(parameters)), np.float32))


def record_length(parameters: int) -> int:
    """Return how many numbers are kept of a point."""
    return FACTORS + 2 * parameters + parameters * (parameters + 1) // 2


@inner
def prepare(image: Reference, shape: Shape, subset: Subset, work: Workspace, record: Flat) -> None:
    """Write what IC-GN needs of a subset of the reference into its record."""
    Q, H, s, t = work.Q, work.H, work.s, work.t
    m.reference_moments(image, shape, subset, Q)
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
    """Copy s, t and the Cholesky factor from a record to the workspace.

    They are rounded to float32 there, so results do not depend on whether a record was kept or just prepared.
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
    """Return the share of a sum over the subset that may be rounding: one last digit for each row."""
    return (2 * r + 1) * _EPSILON


@inner
def _normal_matrix(Q: Flat, n: int, H: Float, s: Float, t: Float) -> tuple[float, float]:
    """Write the Gauss-Newton Hessian of the normalised criterion; return mean and |f̃|² of the subset.

    It is H - ss'/n - tt'/|f̃|²: s sums the steepest-descent vectors and t sums them times f̃, the two
    directions (offset and gain of the grey levels) in which the ZNSSD does not change. The right-hand side
    stays the usual one, so the result is the same, but fewer iterations are needed.
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
