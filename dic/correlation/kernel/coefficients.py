"""The spline coefficients of a deformed image, filtered into the layout of the kernel.

The filter is that of `dic.image.spline`. This module applies it in compiled code and writes the coefficients
where the kernel reads them, without arrays in between: for a deformed image that takes a third of the time.
"""

import numpy as np

from dic.correlation.kernel.jit import compiled
from dic.correlation.kernel.layout import BEYOND, SPARE, Deformed, Flat, pitch_and_origin
from dic.image.spline import MARGIN, inverse_filter
from dic.image.stored import StoredImage
from dic.image.threads import bands_of, in_parallel
from dic.typing import Grey, Indices

_BAND_PX = 128

DENOMINATORS = {3: 6.0, 5: 120.0}
"""Denominators of the B-spline weights."""


def lay_deformed(
    image: StoredImage, order: int, mean: float, threads: int = 1, rows: slice | None = None
) -> Deformed:
    """Return a deformed image for the kernel, with the reference's `mean` subtracted from its grey levels.

    `order`: degree of the spline, 3 or 5. `rows`: the rows to lay, by default all. Their coefficients are
    those of the whole image, which is mirrored at its edges.
    """
    height, width = image.shape
    rows = rows or slice(0, height)
    response = inverse_filter(order)
    taps = response[len(response) // 2 :].astype(np.float32)
    reach, shape = len(taps) - 1, (rows.stop - rows.start + 2 * MARGIN, width + 2 * MARGIN)
    above, below = max(0, rows.start - MARGIN - reach), min(height, rows.stop + MARGIN + reach)
    grey = image.rows(above, below)
    down = mirrored(rows.start - MARGIN - reach, rows.stop + MARGIN + reach, height) - above
    across = mirrored(-MARGIN - reach, width + MARGIN + reach, width)
    flat = np.empty(shape[0] * shape[1] + 2 * SPARE, np.float32)
    flat[:SPARE] = flat[-SPARE:] = 0.0
    plane, factor = flat[SPARE:-SPARE].reshape(shape), 1.0 / DENOMINATORS[order] ** 2

    def lay(band: slice) -> None:
        line = np.empty(len(across), np.float32)
        at = band.start, reach + MARGIN
        filter_rows(grey, down, across, taps, float(mean), factor, plane[band], at, line)

    in_parallel(lay, bands_of(shape[0], _BAND_PX), threads)
    first = rows.start if rows.start > 0 else -BEYOND
    last = rows.stop if rows.stop < height else BEYOND
    return Deformed(flat, *pitch_and_origin(width, rows.start), width, height, first, last)


def mirrored(first: int, last: int, length: int) -> Indices:
    """Return the indices from `first` to `last` - 1, mirrored at both ends of a row of `length` pixels."""
    period = max(1, 2 * (length - 1))
    index = np.arange(first, last) % period
    return np.minimum(index, period - index)


@compiled
def filter_rows(
    grey: Grey,
    down: Indices,
    across: Indices,
    taps: Flat,
    mean: float,
    factor: float,
    plane: Grey,
    begins: tuple[int, int],
    line: Flat,
) -> None:
    """Write coefficients, less `mean` and times `factor`, into some rows of the plane, from its row `top` on.

    The taps have the sum 1. So a coefficient is the grey level plus taps times differences of grey levels,
    whose rounding errors are small in faint patterns, too.

    `taps`: the middle tap of the symmetric filter, and those on one side of it; their number less one is a
    multiple of three. `down`, `across`: for each row and column that the filter reaches, from the first row
    and column of the whole plane on, its place in `grey`. `begins`: the row `top`, and the number of columns
    that the filter reaches before the first column of `grey`. `line` is scratch memory for a row with the
    columns on either side.
    """
    reach, mean32, factor32 = len(taps) - 1, np.float32(mean), np.float32(factor)
    (top, left), width, wide = begins, grey.shape[1], plane.shape[1]
    middle = line[left : left + width]
    for row in range(len(plane)):
        at = top + row + reach
        own = grey[down[at]]
        for x in range(width):
            middle[x] = 0.0
        # The small taps come first, so that their sums lose nothing. Three taps at a time need less memory.
        for k in range(reach, 0, -3):
            a, b, c = taps[k], taps[k - 1], taps[k - 2]
            up, up2, up3 = grey[down[at - k]], grey[down[at - k + 1]], grey[down[at - k + 2]]
            low, low2, low3 = grey[down[at + k]], grey[down[at + k - 1]], grey[down[at + k - 2]]
            for x in range(width):
                two = own[x] + own[x]
                far = a * (up[x] + low[x] - two) + b * (up2[x] + low2[x] - two)
                middle[x] += far + c * (up3[x] + low3[x] - two)
        for x in range(width):
            middle[x] += own[x] - mean32
        for x in range(left):
            line[x] = middle[across[x]]
        for x in range(left + width, len(line)):
            line[x] = middle[across[x]]
        own, to = line[reach : reach + wide], plane[row]
        for x in range(wide):
            to[x] = 0.0
        for k in range(reach, 0, -3):
            a, b, c = taps[k], taps[k - 1], taps[k - 2]
            up, up2, up3 = line[reach - k :], line[reach - k + 1 :], line[reach - k + 2 :]
            low, low2, low3 = line[reach + k :], line[reach + k - 1 :], line[reach + k - 2 :]
            for x in range(wide):
                two = own[x] + own[x]
                far = a * (up[x] + low[x] - two) + b * (up2[x] + low2[x] - two)
                to[x] += far + c * (up3[x] + low3[x] - two)
        for x in range(wide):
            to[x] = (to[x] + own[x]) * factor32
