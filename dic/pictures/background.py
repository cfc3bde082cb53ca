"""The part of an image under a map: as the camera saw it, or as if the specimen were seen straight on."""

from dataclasses import dataclass
from math import ceil, log2
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dic.pictures.marks import Frame
from dic.pictures.places import PointCells, mapped
from dic.typing import Float

_RESIZABLE = (np.uint8, np.uint16, np.float32)
_MOST_PX = 1200
"""Longer side of an image that is rectified. More pixels make a picture slow, not clearer."""

_GREY_PERCENTILES = (1.0, 99.5)
_DARKEST, _LIGHTEST = 0.62, 0.95
"""Grey levels between which the image is drawn, so that the colours over it can be read."""

_MARGIN = 0.05
"""Free space around the points on a picture, as a fraction of the extent of the points."""
_AROUND_PX = 20
"""Further space on a picture in px, so that a single point, too, is shown on its part of the image."""


@dataclass(frozen=True, eq=False)
class Background:
    """Grey levels under a map."""

    grey: NDArray[Any]
    """Shape (height, width). Grey levels of the image, or of fewer pixels; NaN outside the image."""
    extent: tuple[float, float, float, float]
    """Left, right, lower and upper limit of the axes."""

    @property
    def aspect(self) -> float:
        """Height over width."""
        left, right, lower, upper = self.extent
        return abs(upper - lower) / abs(right - left)

    def shown(self, size: tuple[int, int]) -> Frame:
        """Return the image pale and of little contrast, with the given width and height in px."""
        import cv2

        small = _resized(self.grey, size)
        known = np.isfinite(small)
        low, high = np.percentile(small[known], _GREY_PERCENTILES) if known.any() else (0.0, 1.0)
        level = ((small - low) / max(high - low, 1e-6)).clip(0.0, 1.0)
        pale = np.where(known, _DARKEST + (_LIGHTEST - _DARKEST) * level, 1.0)
        return np.asarray(cv2.cvtColor(np.rint(255.0 * pale).astype(np.uint8), cv2.COLOR_GRAY2RGB))


def background_of(image: NDArray[Any], places: PointCells) -> Background:
    """Return the image under a map, in the axes of the places."""
    import cv2

    left, right, lower, upper = places.view or view_of(places.drawn_corners())
    if places.unit != "mm":
        return _part_of(image, (left, right, lower, upper))
    spacing = max(right - left, upper - lower) / _MOST_PX
    columns, rows = max(1, round((right - left) / spacing)), max(1, round((upper - lower) / spacing))
    right, lower = left + columns * spacing, upper - rows * spacing
    # The centre of the first pixel is (0, 0). The left and the upper limit are half a pixel away from it.
    to_raster = np.array(
        [[1 / spacing, 0.0, -left / spacing - 0.5], [0.0, -1 / spacing, upper / spacing - 0.5], [0, 0, 1]]
    )
    to_drawn = to_raster @ places.to_axes
    # `warpPerspective` does not average pixels, so speckles and edges would be jagged in a small picture.
    # Therefore shrink the image first.
    small, to_whole = _shrunk(image, _magnification(to_drawn, places.corners))
    seen = cv2.warpPerspective(
        small.astype(np.float32),
        to_drawn @ to_whole,
        (columns, rows),
        flags=cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=float("nan"),
    )
    return Background(np.asarray(seen), (left, right, lower, upper))


def _part_of(image: NDArray[Any], view: tuple[float, float, float, float]) -> Background:
    """Return the part of an image within limits in px, which are rounded to whole pixels of the image."""
    height, width = image.shape
    left, top = (max(0, round(end) - _AROUND_PX) for end in (view[0], view[2]))
    right, bottom = (
        min(size, round(end) + _AROUND_PX) for end, size in ((view[1], width), (view[3], height))
    )
    part = image[top:bottom, left:right]
    if not part.size:
        part, (left, right, top, bottom) = image, (0, width, 0, height)
    share = 0.5 ** max(0, ceil(log2(max(part.shape) / (2 * _MOST_PX))))
    small, _ = _shrunk(part, (share, share))
    return Background(small, (left - 0.5, right - 0.5, bottom - 0.5, top - 0.5))


def _magnification(homography: Float, points: Float) -> tuple[float, float]:
    """Return the largest width and the largest height of the image of a pixel under a homography."""
    here = mapped(homography, points)
    across, down = (np.linalg.norm(mapped(homography, points + step) - here, axis=-1) for step in np.eye(2))
    return float(across.max()), float(down.max())


def _shrunk(image: NDArray[Any], shares: tuple[float, float]) -> tuple[NDArray[Any], Float]:
    """Return an image with fewer, averaged pixels, and the matrix (3, 3) from its pixels to the image's.

    The new width and height are the given shares of the old ones. A share above 1 counts as 1.
    """
    whole = image.shape[::-1]
    size = tuple(max(1, round(side * min(1.0, share))) for side, share in zip(whole, shares, strict=True))
    small = _resized(image, size)
    right, down = (side / kept for side, kept in zip(whole, size, strict=True))
    # The centres of pixels have integer coordinates, so the left edge is at -0.5 in both images.
    to_whole = np.array([[right, 0.0, (right - 1) / 2], [0.0, down, (down - 1) / 2], [0.0, 0.0, 1.0]])
    return small, to_whole


def _resized(image: NDArray[Any], size: tuple[int, int]) -> NDArray[Any]:
    """Return an image with the given width and height; pixels of a smaller image are means."""
    import cv2

    if image.dtype not in _RESIZABLE:
        image = image.astype(np.float32)
    while image.shape[1] // 2 >= size[0] and image.shape[0] // 2 >= size[1]:
        half = image.shape[1] // 2, image.shape[0] // 2
        # Halves are much faster to compute than other shares.
        image = np.asarray(cv2.resize(image, half, interpolation=cv2.INTER_AREA))
    smaller = size[0] < image.shape[1]
    way = cv2.INTER_AREA if smaller else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(image, size, interpolation=way))


def view_of(corners: Float) -> tuple[float, float, float, float]:
    """Return the least and largest x and the least and largest y of a picture with all corners (…, 2)."""
    x, y = corners[..., 0], corners[..., 1]
    margin = _MARGIN * max(np.ptp(x), np.ptp(y))
    return (
        float(x.min() - margin),
        float(x.max() + margin),
        float(y.min() - margin),
        float(y.max() + margin),
    )
