"""The texture of a large image, computed in bands of rows and pooled, so that its maps need little memory.

The maps of `dic.specimen.texture` take more memory than the image itself. The maps of a large image have a
quarter of the pixels. Slopes are computed at the resolution of the small images, because a pattern that can
be measured may be too fine for a lower resolution. Then the products of the slopes are averaged over squares
of 2 × 2 pixels. Averages over a window hardly change, so all limits stay the same.

Nothing is kept at the resolution of the small images: each band of rows is reduced, differentiated and pooled
before the next one.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dic.image.threads import bands_of, with_neighbours
from dic.specimen.texture import (
    NARROWEST,
    TextureMaps,
    diagonal_difference,
    eigenvalues,
    maps_at,
    slope_gain,
    strength,
    usable_strength,
    window_at,
)
from dic.typing import Grey

_BAND_PX = 512
"""Height of the bands of rows, px; a multiple of 4."""

_HALO_PX = 8
"""Additional rows on either side of a band, which the filters of its outermost rows need; a multiple of 4.

The filters reach 2 rows of the image, then 2 rows of the reduced image.
"""

_POOLED = 2
"""Number of pixels of the reduced image along the side of a square that is averaged."""


class PooledProducts(NamedTuple):
    """Means of fx², fy² and fx fy over squares of pixels."""

    xx: Grey
    yy: Grey
    xy: Grey

    def of_rows(self, rows: slice) -> "PooledProducts":
        """Return the products of some rows."""
        return PooledProducts(self.xx[rows], self.yy[rows], self.xy[rows])

    def weighted(self, weight: Grey) -> Iterator[Grey]:
        """Yield the means times a weight for each pixel."""
        return (each * weight for each in self)


class _Pooled(NamedTuple):
    """Maps of an image at a quarter of its resolution."""

    grey: Grey
    """The image, reduced by 4."""
    products: PooledProducts
    energy: Grey
    curvature: Grey
    magnitude: Grey
    """Means of the squared slope, of the squared Laplacian and of the magnitude of the slope."""
    ripples: Grey
    """Means of the estimates of the variance of the image's noise."""


def pooled_texture_maps(grey: NDArray[Any], subset_px: int) -> TextureMaps:
    """Return the texture of a large image at the resolution at which it is strongest.

    `grey`, shape (height, width): grey levels as stored. `subset_px`: width of the subsets. Windows are not
    wider than a subset.
    """
    import cv2

    pooled = _pooled(grey)
    maps = _maps_of(pooled, subset_px)
    small, ripples, reduction = pooled.grey, pooled.ripples, 2 * _POOLED
    del pooled
    best = strength(maps)
    while subset_px // reduction >= NARROWEST:
        found = _strength_at(small, ripples, subset_px, reduction)
        if found <= best:
            break
        # The maps so far would take twice as much memory as the image.
        del maps
        best, maps = found, maps_at(small, ripples, subset_px, reduction)
        small, reduction = np.asarray(cv2.pyrDown(small), np.float32), 2 * reduction
    return maps


def _pooled(grey: NDArray[Any]) -> _Pooled:
    """Return the maps from which the texture is computed; one band of rows is in work at a time."""
    import cv2

    height, width = grey.shape
    shape = tuple(-(-size // (2 * _POOLED)) for size in (height, width))
    small, xx, yy, xy, energy, curvature, magnitude, ripples = (np.empty(shape, np.float32) for _ in range(8))
    for band, around in _bands(height, _BAND_PX, _HALO_PX):
        stored = np.ascontiguousarray(grey[around], np.float32)
        above = band.start - around.start
        noise = np.square(diagonal_difference(stored[above : above + band.stop - band.start]))
        rows = np.asarray(cv2.pyrDown(stored), np.float32)
        fx = np.asarray(cv2.Sobel(rows, cv2.CV_32F, 1, 0, ksize=3, scale=0.125), np.float32)
        fy = np.asarray(cv2.Sobel(rows, cv2.CV_32F, 0, 1, ksize=3, scale=0.125), np.float32)
        squares = fx * fx, fy * fy
        total = squares[0] + squares[1]
        bend = np.square(np.asarray(cv2.Laplacian(rows, cv2.CV_32F), np.float32))
        own = slice(above // 2, above // 2 - (-(band.stop - band.start) // 2))
        out = slice(band.start // (2 * _POOLED), -(-band.stop // (2 * _POOLED)))
        for whole, of in (
            (xx, squares[0]), (yy, squares[1]), (xy, fx * fy), (energy, total), (curvature, bend),
            (magnitude, np.sqrt(total)),
        ):  # fmt: skip
            whole[out] = _pool(of[own])
        small[out] = cv2.pyrDown(rows)[above // 4 : above // 4 + out.stop - out.start]
        _put(_pool(noise), ripples[out])
    return _Pooled(small, PooledProducts(xx, yy, xy), energy, curvature, magnitude, ripples)


def _maps_of(pooled: _Pooled, subset_px: int) -> TextureMaps:
    """Return the texture of an image that is reduced by 2, pooled."""
    import cv2

    window = window_at(subset_px, 2) // _POOLED | 1
    shape = pooled.grey.shape
    grey, weakest, strongest, noise, spread = (np.empty(shape, np.float32) for _ in range(5))
    for band, around in _bands(shape[0], _BAND_PX // 2, window):
        own = slice(band.start - around.start, band.stop - around.start)

        def mean(of: Grey, around: slice = around, own: slice = own) -> Grey:
            return np.asarray(cv2.blur(of[around], (window, window)), np.float32)[own]

        grey[band] = mean(pooled.grey)
        weakest[band], strongest[band] = eigenvalues(*map(mean, pooled.products))
        noise[band] = np.float32(slope_gain(2)) * mean(pooled.ripples)
        level, total = mean(pooled.magnitude), weakest[band] + strongest[band]
        spread[band] = level * level / np.maximum(total, np.float32(1e-30))
    return TextureMaps(
        reduction=2 * _POOLED,
        window=window,
        grey=grey,
        slopes=pooled.products,
        energy=pooled.energy,
        curvature=pooled.curvature,
        weakest=weakest,
        strongest=strongest,
        noise=noise,
        spread=spread,
    )


def _strength_at(small: Grey, ripples: Grey, subset_px: int, reduction: int) -> float:
    """Return `strength` of the maps that `maps_at` gives, without keeping these maps."""
    import cv2

    if ripples.shape != small.shape:
        ripples = np.asarray(cv2.resize(ripples, small.shape[::-1], interpolation=cv2.INTER_AREA), np.float32)
    found = []
    # Windows have an odd width, so each band begins at an even row of the rows around it.
    for band, around in _bands(len(small), _BAND_PX // 2, window_at(subset_px, reduction) + 1):
        maps = maps_at(small[around], ripples[around], subset_px, reduction)
        first = (band.start - around.start) // 2
        found.append(usable_strength(maps)[first : first - (-(band.stop - band.start) // 2)])
    return float(np.percentile(np.concatenate(found), 90))


def _bands(height: int, band_px: int, halo_px: int) -> Iterator[tuple[slice, slice]]:
    """Yield bands of rows, and the same bands with additional rows on either side.

    A single last row belongs to the band before, because one row alone has no diagonal differences.
    """
    bands = list(bands_of(height, band_px))
    if len(bands) > 1 and bands[-1].stop - bands[-1].start == 1:
        bands[-2:] = [slice(bands[-2].start, height)]
    for band in bands:
        yield band, with_neighbours(band, height, halo_px)


def _pool(of: Grey) -> Grey:
    """Return the means over squares of pixels; the last row and column are repeated if they are odd."""
    import cv2

    down, right = (-size % _POOLED for size in of.shape)
    whole = cv2.copyMakeBorder(of, 0, down, 0, right, cv2.BORDER_REPLICATE) if down or right else of
    size = whole.shape[1] // _POOLED, whole.shape[0] // _POOLED
    return np.asarray(cv2.resize(whole, size, interpolation=cv2.INTER_AREA), np.float32)


def _put(values: Grey, into: Grey) -> None:
    """Write values to an array that may have one more row and one more column, which repeat the last ones."""
    rows, columns = values.shape
    into[:rows, :columns] = values
    into[rows:, :columns] = values[-1:]
    into[:, columns:] = into[:, columns - 1 : columns]
