"""The grid of points of interest, and the pixels that their subsets may use."""

from dataclasses import dataclass

import numpy as np

from dic.errors import CorrelationError
from dic.typing import Indices, Mask

MIN_PIXEL_FRACTION = 0.4
"""Share of a subset's pixels that must lie in the region: less than half, which the lip of a crack leaves."""

EDGE_PX = 4
"""Distance of subsets from the edge of the reference: a small motion must not take them out of view."""


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
        Which points have a subset that the region's edge cuts into parts. Only the part around the point may
        be used.
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
        x = _centred(max(edge, left), min(width - edge - 1, left + across - 1), step_px)
        y = _centred(max(edge, top), min(height - edge - 1, top + down - 1), step_px)
        pixels = _pixels_around(usable, subset_px, y, x)
        active = centres[np.ix_(y, x)] & usable[np.ix_(y, x)] & (pixels >= _fewest_pixels(subset_px))
        cut = np.zeros(active.shape, np.bool_)
        for row, column in np.argwhere(active & (pixels < subset_px**2)):
            part = connected_part(usable, int(x[column]), int(y[row]), subset_px // 2)
            count = int(np.count_nonzero(part))
            cut[row, column] = count < pixels[row, column]
            pixels[row, column] = count
        active &= pixels >= _fewest_pixels(subset_px)
        if active.any():
            return PointGrid(x, y, active, pixels, cut & active)
    raise CorrelationError(
        "region of interest",
        "place points",
        f"an area with texture that holds subsets of {subset_px} px, {EDGE_PX} px from the image's edge",
        "none",
        "enlarge the region, or give a smaller subset (odd, at least 7 px)",
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


def connected_part(usable: Mask, x: int, y: int, radius_px: int) -> Mask:
    """Return which pixels of the subset around (x, y) are connected with its centre, (width, width).

    Beyond a crack or a slit the surface moves differently.
    """
    import cv2

    window = usable[y - radius_px : y + radius_px + 1, x - radius_px : x + radius_px + 1]
    _, parts = cv2.connectedComponents(window.astype(np.uint8), connectivity=4)
    return np.asarray(parts == parts[radius_px, radius_px], np.bool_)


def _fewest_pixels(subset_px: int) -> float:
    return MIN_PIXEL_FRACTION * subset_px**2


def _centred(first: int, last: int, step: int) -> Indices:
    """Return coordinates `step` apart, centred between `first` and `last`.

    A mean strain belongs to the middle of its points, so this should be the middle of the region.
    """
    spare = max(0, last - first) % step
    return np.arange(first + spare // 2, last + 1, step, dtype=np.int64)
