"""Where points of interest can be: a region given by a mask, or wherever the reference has texture."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dic.errors import CorrelationError

Grey = NDArray[np.float32]
Mask = NDArray[np.bool_]

MIN_PIXEL_FRACTION = 0.4
"""Share of a subset's pixels that must lie in the region of interest: almost half, as at a crack's lips."""

EDGE_PX = 4
"""Distance of subsets from the edge of the reference: a small motion must not take them out of view."""

_LONE_EDGE = 0.5
"""A subset whose contrast is held by so much fewer pixels than usual shows an edge, not a pattern."""

_WEAK = 0.02
"""Texture below this share of the image's strong texture (its 90th percentile) is taken for background."""


def textured(fx: Grey, fy: Grey, subset_px: int) -> Mask:
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

    Returns
    -------
    ndarray of bool, shape (height, width)
        Possible centres of subsets.
    """
    import cv2

    def mean(of: Grey) -> Grey:
        return np.asarray(cv2.blur(of, (subset_px, subset_px)), np.float32)

    # Partly in place: nowhere else does a large image take so much memory.
    xx, yy, xy = mean(fx * fx), mean(fy * fy), mean(fx * fy)
    power = xx + yy
    xx -= yy
    del yy
    xy *= 2
    weakest = power - np.hypot(xx, xy, out=xy)
    strong = weakest > _WEAK * np.percentile(weakest[::4, ::4], 90)
    del xx, xy, weakest
    squares = fx * fx
    squares += fy * fy
    squares *= squares
    shared = np.divide(power, np.sqrt(np.maximum(mean(squares), np.float32(1e-30))), out=power)
    del squares
    # A sum over a subset sees texture from one radius outside; another radius keeps the subset whole.
    size = 2 * subset_px - 1
    found = np.asarray(cv2.erode(strong.astype(np.uint8), np.ones((size, size), np.uint8)))
    if found.any():
        found &= shared > np.sqrt(_LONE_EDGE) * np.median(shared[found > 0])
    # Threads of points between two surfaces would make one of them.
    found = np.asarray(cv2.morphologyEx(found, cv2.MORPH_OPEN, np.ones((subset_px // 2,) * 2, np.uint8)))
    _, labels, statistics, _ = cv2.connectedComponentsWithStats(found)
    if len(statistics) < 2:
        return np.zeros(found.shape, np.bool_)
    largest = 1 + int(np.argmax(statistics[1:, cv2.CC_STAT_AREA]))
    return np.asarray(labels == largest, np.bool_)


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

    x: NDArray[np.int64]
    y: NDArray[np.int64]
    active: Mask
    pixels: NDArray[np.int64]
    cut: Mask


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

    rows, columns = np.flatnonzero(centres.any(axis=1)), np.flatnonzero(centres.any(axis=0))
    height, width = centres.shape
    if rows.size:
        edge = subset_px // 2 + EDGE_PX
        x = _spread(max(edge, columns[0]), min(width - edge - 1, columns[-1]), step_px)
        y = _spread(max(edge, rows[0]), min(height - edge - 1, rows[-1]), step_px)
        box = (subset_px, subset_px)
        counts = cv2.boxFilter(usable.astype(np.float32), -1, box, normalize=False)
        pixels = np.rint(np.asarray(counts)[np.ix_(y, x)]).astype(np.int64)
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
        expected=f"an area with texture that holds subsets of {subset_px} px",
        got="none",
        remedy="enlarge the region or choose a smaller subset",
    )


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


def _spread(first: int, last: int, step: int) -> NDArray[np.int64]:
    """Return coordinates `step` apart, in the middle between `first` and `last`.

    A mean strain belongs to the middle of its points, which therefore should be that of the region.
    """
    spare = max(0, last - first) % step
    return np.arange(first + spare // 2, last + 1, step, dtype=np.int64)


def checked_region(region: NDArray[np.bool_], shape: tuple[int, ...]) -> Mask:
    """Return the mask if it has the reference's shape, else raise `CorrelationError`."""
    if region.shape != shape:
        raise CorrelationError(
            "region of interest",
            "compare with the reference",
            expected=f"{shape[1]} x {shape[0]} px",
            got=f"{region.shape[1]} x {region.shape[0]} px",
            remedy="draw the mask over an image of the series",
        )
    return np.ascontiguousarray(region, np.bool_)
