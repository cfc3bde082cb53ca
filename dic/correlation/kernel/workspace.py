"""Memory that all points of one thread use in turn: compiled code allocates none."""

from typing import NamedTuple

import numpy as np

from dic.correlation.kernel.layout import Flat
from dic.correlation.kernel.moments import MOMENTS, REFERENCE_MOMENTS, Rows
from dic.typing import Float


class Workspace(NamedTuple):
    """Arrays of one point, for n parameters; symbols are those of docs/kernel.md.

    Attributes
    ----------
    H : ndarray, shape (n, n)
        Hessian of the normalised criterion, then its Cholesky factor in the lower triangle.
    s, t : ndarray, shape (n,)
        Directions of the offset and of the gain of the grey levels.
    b, d : ndarray, shape (n,)
        Right-hand side, and the step that it gives.
    p, q : ndarray, shape (n,)
        The warp, and the same in float32.
    Q, S : ndarray of float32
        Moments of the reference, and with the deformed image.
    rows : Rows
    D, products : ndarray, shapes (6, 6) and (3, 6)
        For composing quadratic warps.
    """

    H: Float
    s: Float
    t: Float
    b: Float
    d: Float
    p: Float
    q: Flat
    Q: Flat
    S: Flat
    rows: Rows
    D: Float
    products: Float

    @classmethod
    def for_subsets(cls, radius: int, parameters: int) -> "Workspace":
        """Return memory for subsets of a radius and warps of so many parameters."""
        s, t, b, d, p = np.empty((5, parameters))
        width = 2 * radius + 1
        return cls(
            np.empty((parameters, parameters)), s, t, b, d, p, np.empty(parameters, np.float32),
            np.empty(REFERENCE_MOMENTS, np.float32), np.empty(MOMENTS, np.float32),
            Rows(np.empty((2, width), np.float32), np.empty((2, width), np.int64)),
            np.empty((6, 6)), np.empty((3, 6)),
        )  # fmt: skip
