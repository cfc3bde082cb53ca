"""Records of prepared data, one for each subset of the reference, which all images of a series share.

`dic.correlation.kernel.prepared` computes the data.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

# Indices in the record of a point; the vectors s and t and the Cholesky factor begin at FACTORS.
MEAN, NORM2, FX_FX, FY_FY, FACTORS = 0, 1, 2, 3, 4


class Prepared(NamedTuple):
    """Prepared data of the reference's subsets, with one record for each point of a grid."""

    known: NDArray[np.bool_]
    """Shape (rows, columns). True for points whose record is filled."""
    records: NDArray[np.float32]
    """Shape (rows, columns, n). One record for each point. A record contains the mean of the subset's grey
    levels f, and the sum |f̃|² of squared differences between grey levels and mean (NaN without texture). The
    record also contains ∑fx², ∑fy², the vectors s and t, and the Cholesky factor of the Hessian H.
    """

    @classmethod
    def empty(cls, shape: tuple[int, int], parameters: int) -> "Prepared":
        """Return empty records for the points of a grid; they take memory only when they are filled."""
        return cls(np.zeros(shape, np.bool_), np.empty((*shape, record_length(parameters)), np.float32))


def record_length(parameters: int) -> int:
    """Return the number of values in the record of a point."""
    return FACTORS + 2 * parameters + parameters * (parameters + 1) // 2
