"""Find the textured part of the reference, which is measured if no region of interest is given."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dic.image.threads import bands_of, in_parallel
from dic.typing import Grey, Mask

Bits = NDArray[np.uint8]
"""A mask for OpenCV, with the values 0 and 1."""

_WEAK = 0.02
"""Texture weaker than this fraction of the image's strong texture (its 90th percentile) is background."""

_LONE_EDGE = 0.5
"""A subset shows a lone edge if the spread of its gradients is below this fraction of the median spread."""

_BAND_PX = 128
"""Height of the bands of rows in which texture is computed, px."""

_SAMPLE = 1000
"""Number of values that is enough for a median."""


def textured(fx: Grey, fy: Grey, subset_px: int, threads: int = 1) -> Mask:
    """Return the largest part of the image in which whole subsets have texture in every direction.

    A subset has texture if it passes two tests. The first test uses the 2 × 2 matrix of the sums ∑fx², ∑fx fy
    and ∑fy² over the subset. The smaller eigenvalue of this matrix must exceed a fraction of the 90th
    percentile of all subsets' smaller eigenvalues. A dark background, which shows only the sensor's noise,
    fails this test. The second test uses the squared gradient g = fx² + fy² of the n pixels of the subset.
    The spread (∑g)² / (n∑g²) must not be much smaller than in most subsets. The spread is 1/2 for a Gaussian
    texture, and much smaller if only a few edges in the subset have strong gradients.

    Parameters
    ----------
    fx, fy : ndarray, shape (height, width)
        Derivatives of the image along x and y.
    subset_px : int
    threads : int

    Returns
    -------
    ndarray of bool, shape (height, width)
        True at pixels that may be the centre of a subset.
    """
    import cv2

    weakest, spread = np.empty_like(fx), np.empty_like(fx)
    bands = bands_of(len(fx), _BAND_PX)

    def judge(band: slice) -> None:
        rows, own = _with_rows_around(band, subset_px // 2, len(fx))
        weakest_in_rows, spread_in_rows = _texture(fx[rows], fy[rows], subset_px)
        weakest[band], spread[band] = weakest_in_rows[own], spread_in_rows[own]

    in_parallel(judge, bands, threads)
    strong = (weakest > _WEAK * np.percentile(weakest[::4, ::4], 90)).view(np.uint8)
    # The sums of a subset include texture up to one subset radius away. So erode the mask by twice the
    # radius, to keep whole subsets on texture.
    found = _in_bands(cv2.erode, strong, 2 * subset_px - 1, threads)
    if found.any():
        found &= spread > np.sqrt(_LONE_EDGE) * _median_of(spread, found)
    # Remove narrow bridges of points, which would connect two surfaces.
    found = _in_bands(cv2.erode, found, subset_px // 2, threads)
    found = _in_bands(cv2.dilate, found, subset_px // 2, threads)
    if found.all():
        return found.view(np.bool_)
    _, labels, statistics, _ = cv2.connectedComponentsWithStats(found)
    if len(statistics) < 2:
        return np.zeros(found.shape, np.bool_)
    largest = 1 + int(np.argmax(statistics[1:, cv2.CC_STAT_AREA]))
    return np.asarray(labels == largest, np.bool_)


def _texture(fx: Grey, fy: Grey, subset_px: int) -> tuple[Grey, Grey]:
    """Return the two values of each subset that the two tests of `textured` use.

    The first value is proportional to the smaller eigenvalue, the second is the square root of the spread.
    """
    import cv2

    def mean(of: Grey) -> Grey:
        return np.asarray(cv2.blur(of, (subset_px, subset_px)), np.float32)

    squares_x, squares_y = fx * fx, fy * fy
    xx, yy, xy = mean(squares_x), mean(squares_y), mean(fx * fy)
    power = xx + yy
    weakest = power - np.sqrt(np.square(xx - yy) + 4 * np.square(xy))
    fourth = mean(np.square(squares_x + squares_y))
    return weakest, np.divide(power, np.sqrt(np.maximum(fourth, np.float32(1e-30))), dtype=np.float32)


def _with_rows_around(band: slice, radius: int, height: int) -> tuple[slice, slice]:
    """Return the rows that a filter needs for a band of rows, and the place of the band in these rows."""
    first = max(0, band.start - radius)
    rows = slice(first, min(height, band.stop + radius))
    return rows, slice(band.start - first, band.stop - first)


def _in_bands(morphology: Callable[..., Any], mask: Bits, width: int, threads: int) -> Bits:
    """Return the mask after `cv2.erode` or `cv2.dilate` with a square of side `width`."""
    square, out = np.ones((width, width), np.uint8), np.empty_like(mask)

    def work(band: slice) -> None:
        rows, own = _with_rows_around(band, width // 2, len(mask))
        out[band] = morphology(mask[rows], square)[own]

    in_parallel(work, bands_of(len(mask), _BAND_PX), threads)
    return out


def _median_of(values: Grey, where: Bits) -> float:
    """Return the median of the values in a mask; use only every fourth row and column if these are enough."""
    sample = values[::4, ::4][where[::4, ::4] > 0]
    return float(np.median(sample if sample.size >= _SAMPLE else values[where > 0]))
