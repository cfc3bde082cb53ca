"""Where points of interest can be: a region given by a mask, or wherever the reference has texture."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dic.errors import CorrelationError
from dic.image.threads import bands_of, in_parallel
from dic.typing import Grey, Indices, Mask

Bits = NDArray[np.uint8]

MIN_PIXEL_FRACTION = 0.4
"""Share of a subset's pixels that must lie in the region of interest: almost half, as at a crack's lips."""

EDGE_PX = 4
"""Distance of subsets from the edge of the reference: a small motion must not take them out of view."""

_LONE_EDGE = 0.5
"""A subset whose contrast is held by so much fewer pixels than usual shows an edge, not a pattern."""

_WEAK = 0.02
"""Texture below this share of the image's strong texture (its 90th percentile) is taken for background."""

_BAND_PX = 128
"""Height of the bands in which texture is judged."""

_SAMPLE = 1000
"""Values that tell a median well enough."""


def textured(fx: Grey, fy: Grey, subset_px: int, threads: int = 1) -> Mask:
    """Return where whole subsets have texture in every direction: the largest such part of the image.

    The smaller eigenvalue of the summed gradient products is compared with its upper range over the
    image; unlit background has only the sensor's noise, far below. In a pattern many pixels share the squared
    gradients g: (Σg)² / (nΣg²) is 1/2 for a Gaussian texture, and far less where a few lone edges, of the
    specimen or of what lies beside it, hold them all.

    Parameters
    ----------
    fx, fy : ndarray, shape (height, width)
        Derivatives of the image along x and y.
    subset_px : int
    threads : int

    Returns
    -------
    ndarray of bool, shape (height, width)
        Possible centres of subsets.
    """
    import cv2

    weakest, shared = np.empty_like(fx), np.empty_like(fx)
    bands = bands_of(len(fx), _BAND_PX)

    def judge(band: slice) -> None:
        rows, own = _with_rows_around(band, subset_px // 2, len(fx))
        weak, even = _texture(fx[rows], fy[rows], subset_px)
        weakest[band], shared[band] = weak[own], even[own]

    in_parallel(judge, bands, threads)
    strong = (weakest > _WEAK * np.percentile(weakest[::4, ::4], 90)).view(np.uint8)
    # A sum over a subset sees texture from one radius outside; another radius keeps the subset whole.
    found = _in_bands(cv2.erode, strong, 2 * subset_px - 1, threads)
    if found.any():
        found &= shared > np.sqrt(_LONE_EDGE) * _median_of(shared, found)
    # Threads of points between two surfaces would make one of them.
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
    """Return the weakest texture of any direction in each subset, and how evenly its pixels hold it."""
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
    """Return a band with the rows that a filter of this radius needs, and where in them the band is."""
    first = max(0, band.start - radius)
    rows = slice(first, min(height, band.stop + radius))
    return rows, slice(band.start - first, band.stop - first)


def _in_bands(filtered: Callable[..., Any], mask: Bits, width: int, threads: int) -> Bits:
    """Return the mask after erosion or dilation by a square."""
    square, out = np.ones((width, width), np.uint8), np.empty_like(mask)

    def work(band: slice) -> None:
        rows, own = _with_rows_around(band, width // 2, len(mask))
        out[band] = filtered(mask[rows], square)[own]

    in_parallel(work, bands_of(len(mask), _BAND_PX), threads)
    return out


def _median_of(values: Grey, where: Bits) -> float:
    """Return the median of values where a mask is true: of every fourth in every fourth row, if they do."""
    sample = values[::4, ::4][where[::4, ::4] > 0]
    return float(np.median(sample if sample.size >= _SAMPLE else values[where > 0]))


@dataclass(frozen=True)
class PointGrid:
    """The grid of points of interest laid over a region.

    Attributes
    ----------
    x, y : ndarray of int, shapes (columns,) and (rows,)
        Coordinates, px.
    active : ndarray of bool, shape (rows, columns)
        Which points are to be measured.
    pixels : ndarray of int, shape (rows, columns)
        How many pixels of each point's subset may be used.
    cut : ndarray of bool, shape (rows, columns)
        Whose subset the region's edge cuts into parts. Only the part around the point may be used.
    """

    x: Indices
    y: Indices
    active: Mask
    pixels: Indices
    cut: Mask

    def points_at(self, indices: Indices) -> Indices:
        """Return the points (x, y), shape (n, 2), at `indices` (row, column)."""
        return np.stack([self.x[indices[:, 1]], self.y[indices[:, 0]]], axis=1)


def place_points(centres: Mask, usable: Mask, subset_px: int, step_px: int) -> PointGrid:
    """Lay the grid of points of interest over a region.

    Parameters
    ----------
    centres : ndarray of bool, shape (height, width)
        Where a point may be.
    usable : ndarray of bool, shape (height, width)
        Which pixels subsets may use.
    subset_px, step_px : int

    Raises
    ------
    CorrelationError
        If no point can be placed.
    """
    import cv2

    left, top, across, down = cv2.boundingRect(centres.view(np.uint8))
    height, width = centres.shape
    if across:
        edge = subset_px // 2 + EDGE_PX
        x = _spread(max(edge, left), min(width - edge - 1, left + across - 1), step_px)
        y = _spread(max(edge, top), min(height - edge - 1, top + down - 1), step_px)
        pixels = _pixels_around(usable, subset_px, y, x)
        active = centres[np.ix_(y, x)] & usable[np.ix_(y, x)] & (pixels >= _fewest_pixels(subset_px))
        cut = np.zeros(active.shape, np.bool_)
        for row, column in np.argwhere(active & (pixels < subset_px**2)):
            part = own_part(usable, int(x[column]), int(y[row]), subset_px // 2)
            count = int(np.count_nonzero(part))
            cut[row, column] = count < pixels[row, column]
            pixels[row, column] = count
        active &= pixels >= _fewest_pixels(subset_px)
        if active.any():
            return PointGrid(x, y, active, pixels, cut & active)
    raise CorrelationError(
        "region of interest",
        "place points",
        f"an area with texture that holds subsets of {subset_px} px",
        "none",
        "enlarge the region or choose a smaller subset",
    )


def _pixels_around(usable: Mask, subset_px: int, y: Indices, x: Indices) -> Indices:
    """Return how many usable pixels the subsets at rows y and columns x have, (rows, columns)."""
    import cv2

    if usable.all():
        return np.full((len(y), len(x)), subset_px**2, np.int64)
    box = (subset_px, subset_px)
    counts = np.asarray(cv2.boxFilter(usable.view(np.uint8), cv2.CV_32F, box, normalize=False))
    pixels: Indices = np.rint(counts[np.ix_(y, x)]).astype(np.int64)
    return pixels


def own_part(usable: Mask, x: int, y: int, radius_px: int) -> Mask:
    """Return which pixels of the subset around (x, y) hang together with its centre, (width, width).

    Beyond a crack or a slit the surface moves on its own.
    """
    import cv2

    window = usable[y - radius_px : y + radius_px + 1, x - radius_px : x + radius_px + 1]
    _, parts = cv2.connectedComponents(window.astype(np.uint8), connectivity=4)
    return np.asarray(parts == parts[radius_px, radius_px], np.bool_)


def _fewest_pixels(subset_px: int) -> float:
    return MIN_PIXEL_FRACTION * subset_px**2


def _spread(first: int, last: int, step: int) -> Indices:
    """Return coordinates `step` apart, in the middle between `first` and `last`.

    A mean strain belongs to the middle of its points, which therefore should be that of the region.
    """
    spare = max(0, last - first) % step
    return np.arange(first + spare // 2, last + 1, step, dtype=np.int64)
