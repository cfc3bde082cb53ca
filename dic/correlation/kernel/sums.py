"""Where the sums over a subset ("moments") are kept: their places in arrays, and scratch memory for them.

`dic.correlation.kernel.moments` computes the sums.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dic.correlation.kernel.layout import Flat

# Indices of the moments of the reference. PRODUCTS: the sums ∑fx fx m, ∑fx fy m and ∑fy fy m, for each of the
# fifteen monomials m = 1; x, y; x², xy, y²; … up to the fourth degree. FX_F, FY_F, FX, FY: the sums ∑fx f m,
# ∑fy f m, ∑fx m and ∑fy m, for each of the six monomials m up to the second degree. F, FF: the sums ∑f and
# ∑f².
PRODUCTS, FX_F, FY_F, FX, FY, F, FF = 0, 45, 51, 57, 63, 69, 70
REFERENCE_MOMENTS = 71
# Indices of the moments with the deformed image. FX_G, FY_G: the sums ∑fx g m and ∑fy g m, for each of the
# six monomials m. G, GG, FG: the sums ∑g, ∑g² and ∑f g.
FX_G, FY_G, G, GG, FG = 0, 6, 12, 13, 14
MOMENTS = 15


class StripRows(NamedTuple):
    """The positions of a strip's rows in the deformed image. A strip is a group of columns of a subset."""

    shift: Flat
    """Shape (2, rows). The part of the displacement along x and y that is the same for all pixels of a row,
    minus the whole pixels that are kept in `place`.
    """
    place: NDArray[np.int64]
    """Shape (2, rows). ``place[0]`` is the whole-pixel part of the displacement of each row of the strip, as
    a number of array elements. ``place[1]`` is 1 if the row of the strip reaches into the next cell between
    pixels, to the right or below, and otherwise 0.
    """
