"""The grid of points of interest, and the pixels that the subset of each point may use."""

from dataclasses import dataclass

import numpy as np

from dic.errors import CorrelationError
from dic.image.threads import bands_of
from dic.typing import Indices, Mask

MIN_PIXEL_FRACTION = 0.4
"""Fraction of a subset's pixels that must lie in the region.

A subset at the edge of a crack has about half of its pixels in the region, so the fraction is below one half.
"""

EDGE_PX = 4
"""Smallest distance of a subset from the image's edge, so that a small motion keeps the subset in view."""


_BAND_PX, _HALO_PX = 512, 16
"""Height of the bands of rows in which the edges of a region are examined, and spare rows around a band."""

_ROWS = 128
"""Number of rows of the grid whose subsets are counted at a time."""


@dataclass(frozen=True, eq=False)
class PointGrid:
    """The grid of points of interest that covers a region."""

    x: Indices
    y: Indices
    """Shapes (columns,) and (rows,). Coordinates of the columns and of the rows of points, px."""
    active: Mask
    """Shape (rows, columns). True for points to be measured."""
    pixels: Indices
    """Shape (rows, columns). Number of usable pixels in the subset of each point."""
    cut: Mask
    """Shape (rows, columns). True for points whose subset is cut into parts by the region's edge. Only the
    part of the subset around the point may be used.
    """
    usable: Mask
    """Shape (height, width). True for pixels that subsets may use."""

    def points_at(self, indices: Indices) -> Indices:
        """Return the coordinates (x, y) in px of the points at `indices` (row, column), shape (n, 2)."""
        return np.stack([self.x[indices[:, 1]], self.y[indices[:, 0]]], axis=1)


def place_points(centres: Mask, usable: Mask, subset_px: int, step_px: int) -> PointGrid:
    """Cover a region with a grid of points of interest.

    `centres`, shape (height, width): True at pixels that may be points of interest. `usable`, shape (height,
    width): True at pixels that subsets may use.

    Raises `CorrelationError` if no point can be placed.
    """
    import cv2

    height, width = centres.shape
    # OpenCV would need a copy of a mask that repeats one element.
    whole = 0, 0, width, height
    left, top, across, down = whole if centres.all() else cv2.boundingRect(centres.view(np.uint8))
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
            return PointGrid(x, y, active, pixels, cut & active, usable)
    raise CorrelationError(
        "region of interest",
        "place points",
        f"an area with texture that holds subsets of {subset_px} px, {EDGE_PX} px from the image's edge",
        "none",
        "enlarge the region, or give a smaller subset (odd, at least 7 px)",
    )


def clear_of_edges(region: Mask, subset_px: int, reach_px: int) -> Mask:
    """Return the pixels of a region that its edges do not disturb.

    Beyond the region's edge there may be a crack or the background, which does not move with the surface. The
    spline of an image oscillates beside such an edge. If a part of the region is so narrow that no subset
    fits between its disturbed pixels, the whole part is returned, because otherwise this part could not be
    measured.

    `reach_px`: distance from the region's edge within which pixels are disturbed. The edge of the image does
    not count. `region` has the shape (height, width).
    """
    if region.all():
        return region
    least_px = int(np.ceil(MIN_PIXEL_FRACTION * subset_px))
    height, halo = len(region), 2 * least_px + 4 * reach_px + _HALO_PX
    clear = np.empty_like(region)
    for band in bands_of(height, _BAND_PX):
        # Additional rows on either side hold all that decides about the rows of the band.
        above = max(0, band.start - halo)
        around = np.ascontiguousarray(region[above : band.stop + halo])
        clear[band] = _clear(around, least_px, reach_px)[band.start - above : band.stop - above]
    return clear


def _clear(region: Mask, least_px: int, reach_px: int) -> Mask:
    """Return the pixels of a region that its edges do not disturb, and the parts that are too narrow.

    A part is too narrow if no square of `least_px` pixels fits between its disturbed pixels.
    """
    import cv2

    clear = (cv2.distanceTransform(region.view(np.uint8), cv2.DIST_L2, 5) > reach_px).view(np.uint8)
    wide = cv2.morphologyEx(clear, cv2.MORPH_OPEN, np.ones((least_px, least_px), np.uint8))
    # A corner of the region is 1.42 times as far from the undisturbed pixels as the region's sides.
    rim = cv2.distanceTransform(1 - wide, cv2.DIST_L2, 5) <= 1.5 * reach_px + 1.0
    return np.asarray(wide.astype(bool) | (region & ~rim))


def _pixels_around(usable: Mask, subset_px: int, y: Indices, x: Indices) -> Indices:
    """Return the number of usable pixels in the subset around each point (x, y), shape (rows, columns)."""
    import cv2

    if usable.all():
        return np.full((len(y), len(x)), subset_px**2, np.int64)
    box = (subset_px, subset_px)
    pixels, radius = np.empty((len(y), len(x)), np.int64), subset_px // 2
    for first in range(0, len(y), _ROWS):
        own = slice(first, first + _ROWS)
        # Subsets lie inside the image, so no subset reaches beyond these rows.
        top = y[own][0] - radius
        rows = np.ascontiguousarray(usable[top : y[own][-1] + radius + 1]).view(np.uint8)
        counts = np.asarray(cv2.boxFilter(rows, cv2.CV_32F, box, normalize=False))
        pixels[own] = np.rint(counts[np.ix_(y[own] - top, x)])
    return pixels


def connected_part(usable: Mask, x: int, y: int, radius_px: int) -> Mask:
    """Return a mask of the pixels of a subset that are connected with its centre (x, y), (width, width).

    Only connected pixels are used, because the surface beyond a crack or a slit moves differently.
    """
    import cv2

    window = usable[y - radius_px : y + radius_px + 1, x - radius_px : x + radius_px + 1]
    _, parts = cv2.connectedComponents(window.astype(np.uint8), connectivity=4)
    return np.asarray(parts == parts[radius_px, radius_px], np.bool_)


def _fewest_pixels(subset_px: int) -> float:
    return MIN_PIXEL_FRACTION * subset_px**2


def _centred(first: int, last: int, step: int) -> Indices:
    """Return coordinates `step` apart, centred between `first` and `last`.

    The mean strain of a region is the strain at the middle of its points. Because the points are centred,
    their middle is the middle of the region.
    """
    spare = max(0, last - first) % step
    return np.arange(first + spare // 2, last + 1, step, dtype=np.int64)
