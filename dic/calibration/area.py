"""The calibrated area of an image, in which all points of interest must lie."""

import numpy as np

from dic.calibration.calibration import Calibration
from dic.image.threads import bands_of
from dic.typing import Mask

_BAND_PX = 128
"""Height of the bands of rows in which the area is found, px."""


def calibrated_area(calibration: Calibration, shape: tuple[int, ...]) -> Mask:
    """Return a mask of the calibrated area of images of a shape (height, width)."""
    inside = np.empty(shape, np.bool_)
    for band in bands_of(shape[0], _BAND_PX):
        rows = np.indices(inside[band].shape).reshape(2, -1) + np.array([[band.start], [0]])
        inside[band] = calibration.inside(rows[::-1].T).reshape(inside[band].shape)
    return inside
