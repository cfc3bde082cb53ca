"""Where points of interest can be: a region given by a mask, or wherever the reference has texture."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dic.errors import CorrelationError

Grey = NDArray[np.float32]
Mask = NDArray[np.bool_]

MIN_PIXEL_FRACTION = 0.5
"""Share of a subset's pixels that must lie inside the region of interest."""

EDGE_PX = 4
"""Distance of subsets from the edge of the reference: a small motion must not take them out of view."""

_WEAK = 0.02
"""Texture below this share of the image's strong texture (its 90th percentile) is taken for background."""


def textured(fx: Grey, fy: Grey, subset_px: int) -> Mask:
    """Return where whole subsets have texture in every direction: the largest such part of the image.

    The smaller eigenvalue of the summed gradient products is compared with its upper range over the
    image; unlit background has only the sensor's noise, far below.

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

    size = (subset_px, subset_px)
    xx, yy, xy = (cv2.blur(a, size) for a in (fx * fx, fy * fy, fx * fy))
    weakest = (xx + yy) / 2 - np.sqrt((xx - yy) ** 2 / 4 + xy**2)
    found = (weakest > _WEAK * np.percentile(weakest, 90)).astype(np.uint8)
    # A sum over a subset sees texture from one radius outside; another radius keeps the subset whole.
    found = np.asarray(cv2.erode(found, np.ones((2 * subset_px - 1, 2 * subset_px - 1), np.uint8)))
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
    """

    x: NDArray[np.int64]
    y: NDArray[np.int64]
    active: Mask
    pixels: NDArray[np.int64]


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

    rows, columns = np.nonzero(centres)
    height, width = centres.shape
    if rows.size:
        edge = subset_px // 2 + EDGE_PX
        x = _spread(max(edge, columns.min()), min(width - edge - 1, columns.max()), step_px)
        y = _spread(max(edge, rows.min()), min(height - edge - 1, rows.max()), step_px)
        box = (subset_px, subset_px)
        counts = cv2.boxFilter(usable.astype(np.float32), -1, box, normalize=False)
        pixels = np.rint(np.asarray(counts)[np.ix_(y, x)]).astype(np.int64)
        active = centres[np.ix_(y, x)] & (pixels >= MIN_PIXEL_FRACTION * subset_px**2)
        if active.any():
            return PointGrid(x, y, active, pixels)
    raise CorrelationError(
        "region of interest",
        "place points",
        expected=f"an area with texture that holds subsets of {subset_px} px",
        got="none",
        remedy="enlarge the region or choose a smaller subset",
    )


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
