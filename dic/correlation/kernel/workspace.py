"""Scratch memory for the points of one thread, because compiled code allocates no memory."""

from typing import NamedTuple

import numpy as np

from dic.correlation.kernel.layout import Flat
from dic.correlation.kernel.sums import MOMENTS, REFERENCE_MOMENTS, StripRows
from dic.typing import Float


class Workspace(NamedTuple):
    """Arrays for one point with n warp parameters; docs/kernel.md explains the symbols."""

    H: Float
    """Shape (n, n). Hessian of the normalised criterion. The Cholesky factor later replaces the lower
    triangle.
    """
    s: Float
    t: Float
    """Shape (n,). Vectors that account for an offset and for a gain of the grey levels in the normal
    equations.
    """
    b: Float
    d: Float
    """Shape (n,). Right-hand side of the normal equations, and the step that solves them."""
    p: Float
    q: Flat
    """Shape (n,). The warp in float64 and in float32."""
    Q: Flat
    S: Flat
    """Moments (sums over a subset) of the reference alone, and moments with the deformed image."""
    rows: StripRows
    """Positions in the deformed image of the rows of a strip, a group of columns of a subset."""
    D: Float
    products: Float
    """Shape (6, 6) and (3, 6). Scratch memory for the composition of quadratic warps."""

    @classmethod
    def for_subsets(cls, radius: int, parameters: int) -> "Workspace":
        """Return scratch memory for subsets of the given radius and warps with `parameters` parameters."""
        s, t, b, d, p = np.empty((5, parameters))
        width = 2 * radius + 1
        return cls(
            np.empty((parameters, parameters)), s, t, b, d, p, np.empty(parameters, np.float32),
            np.empty(REFERENCE_MOMENTS, np.float32), np.empty(MOMENTS, np.float32),
            StripRows(np.empty((2, width), np.float32), np.empty((2, width), np.int64)),
            np.empty((6, 6)), np.empty((3, 6)),
        )  # fmt: skip
