"""The texture of a large image, computed in bands of rows and pooled, so that its maps need little memory.

The maps of `dic.specimen.texture` take more memory than the image itself. The maps of a large image have a
quarter of the pixels. Slopes are computed at the resolution of the small images, because a pattern that can
be measured may be too fine for a lower resolution. Then the products of the slopes are averaged over squares
of 2 × 2 pixels. Averages over a window hardly change, so all limits stay the same.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dic.image.threads import bands_of
from dic.specimen.texture import (
    TextureMaps,
    at_best_scale,
    diagonal_difference,
    eigenvalues,
    slope_gain,
    window_at,
)
from dic.typing import Grey

_BAND_PX = 512
_HALO_PX = 4
"""Additional rows on either side of a band, which the filters of its outermost rows need; an even number."""

_POOLED = 2
"""Number of pixels of the reduced image along the side of a square that is averaged."""


class PooledProducts(NamedTuple):
    """Means of fx², fy² and fx fy over squares of pixels."""

    xx: Grey
    yy: Grey
    xy: Grey

    def weighted(self, weight: Grey) -> tuple[Grey, Grey, Grey]:
        """Return the means times a weight for each pixel."""
        return self.xx * weight, self.yy * weight, self.xy * weight


def pooled_texture_maps(grey: NDArray[Any], subset_px: int) -> TextureMaps:
    """Return the texture of a large image at the resolution at which it is strongest.

    Parameters
    ----------
    grey : ndarray, shape (height, width)
        Grey levels as stored.
    subset_px : int
        Width of the subsets. Windows are not wider than a subset.
    """
    small, ripples = _reduced(grey)
    return at_best_scale(_pooled_maps(small, ripples, subset_px), small, ripples, subset_px)


def _reduced(grey: NDArray[Any]) -> tuple[Grey, Grey]:
    """Return the image reduced by 2, and the estimates of its noise."""
    import cv2

    height, width = grey.shape
    small = np.empty((-(-height // 2), -(-width // 2)), np.float32)
    ripples = np.empty((height // 2, width // 2), np.float32)
    for band, around in _bands(height):
        rows = np.ascontiguousarray(grey[around], np.float32)
        first = (band.start - around.start) // 2
        own = slice(band.start // 2, -(-band.stop // 2))
        small[own] = cv2.pyrDown(rows)[first : first + own.stop - own.start]
        noise = diagonal_difference(rows[band.start - around.start : band.stop - around.start])
        ripples[own.start : own.start + len(noise)] = np.square(noise)
    return small, ripples


def _pooled_maps(small: Grey, ripples: Grey, subset_px: int) -> TextureMaps:
    """Return the texture of an image that is reduced by 2, pooled."""
    import cv2

    height, width = small.shape
    shape = -(-height // _POOLED), -(-width // _POOLED)
    grey, xx, yy, xy, energy, curvature, magnitude = np.empty((7, *shape), np.float32)
    for band, around in _bands(height):
        rows = small[around]
        fx = np.asarray(cv2.Sobel(rows, cv2.CV_32F, 1, 0, ksize=3, scale=0.125), np.float32)
        fy = np.asarray(cv2.Sobel(rows, cv2.CV_32F, 0, 1, ksize=3, scale=0.125), np.float32)
        squares = fx * fx, fy * fy
        total = squares[0] + squares[1]
        bend = np.square(np.asarray(cv2.Laplacian(rows, cv2.CV_32F), np.float32))
        own = slice(band.start - around.start, band.stop - around.start)
        pooled = slice(band.start // _POOLED, -(-band.stop // _POOLED))
        for out, of in (
            (grey, rows), (xx, squares[0]), (yy, squares[1]), (xy, fx * fy), (energy, total),
            (curvature, bend), (magnitude, np.sqrt(total)),
        ):  # fmt: skip
            out[pooled] = _pool(of[own])
    window = window_at(subset_px, 2) // _POOLED | 1

    def mean(of: Grey) -> Grey:
        return np.asarray(cv2.blur(of, (window, window)), np.float32)

    weakest, strongest = eigenvalues(mean(xx), mean(yy), mean(xy))
    level = mean(magnitude)
    noise = np.asarray(cv2.resize(ripples, shape[::-1], interpolation=cv2.INTER_AREA), np.float32)
    return TextureMaps(
        reduction=2 * _POOLED,
        window=window,
        grey=mean(grey),
        slopes=PooledProducts(xx, yy, xy),
        energy=energy,
        curvature=curvature,
        weakest=weakest,
        strongest=strongest,
        noise=np.float32(slope_gain(2)) * mean(noise),
        spread=level * level / np.maximum(weakest + strongest, np.float32(1e-30)),
    )


def _bands(height: int) -> Iterator[tuple[slice, slice]]:
    """Yield bands of rows, and the same bands with additional rows on either side."""
    for band in bands_of(height, _BAND_PX):
        yield band, slice(max(0, band.start - _HALO_PX), min(height, band.stop + _HALO_PX))


def _pool(of: Grey) -> Grey:
    """Return the means over squares of pixels; the last row and column are repeated if they are odd."""
    import cv2

    down, right = (-size % _POOLED for size in of.shape)
    whole = cv2.copyMakeBorder(of, 0, down, 0, right, cv2.BORDER_REPLICATE) if down or right else of
    size = whole.shape[1] // _POOLED, whole.shape[0] // _POOLED
    return np.asarray(cv2.resize(whole, size, interpolation=cv2.INTER_AREA), np.float32)
