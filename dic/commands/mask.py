"""Masks that people draw: where to measure."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dic.errors import CorrelationError
from dic.images import read_image


def read_mask(path: Path) -> NDArray[np.bool_]:
    """Return a mask image as booleans, (height, width): brighter than half of its brightest grey level.

    Raises
    ------
    MeasurementError
        If it cannot be read, or is all of one grey.
    """
    mask = read_image(path)
    if mask.max() <= mask.min():
        raise CorrelationError(
            str(path),
            "read region of interest",
            expected="a mask with white where to measure and black elsewhere",
            got="one uniform grey",
            remedy="draw the mask again, or leave --roi out",
        )
    return np.asarray(mask > mask.max() / 2, np.bool_)
