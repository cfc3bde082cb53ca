"""The image under a map: as the camera saw it, or as if the specimen were seen straight on."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dic.pictures.places import Places
from dic.typing import Float

_MOST_PX = 1200
"""Longer side of the image that is drawn. More pixels make a picture slow and large, not clearer."""

_MARGIN = 0.05
"""Free space around the points on rectified pictures, as a fraction of their extent."""


@dataclass(frozen=True)
class Background:
    """Grey levels under a map.

    Attributes
    ----------
    grey : ndarray, shape (height, width)
        Grey levels to draw; NaN outside the image.
    extent : (float, float, float, float)
        Left, right, lower and upper limit of the axes.
    """

    grey: NDArray[Any]
    extent: tuple[float, float, float, float]

    @property
    def aspect(self) -> float:
        """Height over width."""
        left, right, lower, upper = self.extent
        return abs(upper - lower) / abs(right - left)


def background_of(image: NDArray[Any], places: Places) -> Background:
    """Return the image under a map, in the axes of the places."""
    import cv2

    height, width = image.shape
    if places.unit != "mm":
        shrink = min(1.0, _MOST_PX / max(height, width))
        size = max(1, round(width * shrink)), max(1, round(height * shrink))
        small = cv2.resize(image.astype(np.float32), size, interpolation=cv2.INTER_AREA)
        return Background(np.asarray(small), (-0.5, width - 0.5, height - 0.5, -0.5))
    left, right, lower, upper = _limits(places.drawn_corners())
    spacing = max(right - left, upper - lower) / _MOST_PX
    size = max(1, round((right - left) / spacing)), max(1, round((upper - lower) / spacing))
    to_raster = np.array(
        [[1 / spacing, 0.0, -left / spacing], [0.0, -1 / spacing, upper / spacing], [0, 0, 1]]
    )
    seen = cv2.warpPerspective(
        image.astype(np.float32),
        to_raster @ places.to_axes,
        size,
        flags=cv2.INTER_AREA,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=float("nan"),
    )
    return Background(np.asarray(seen), (left, right, lower, upper))


def _limits(corners: Float) -> tuple[float, float, float, float]:
    x, y = corners[..., 0], corners[..., 1]
    margin = _MARGIN * max(np.ptp(x), np.ptp(y))
    return (
        float(x.min() - margin),
        float(x.max() + margin),
        float(y.min() - margin),
        float(y.max() + margin),
    )
