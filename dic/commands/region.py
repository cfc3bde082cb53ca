"""Masks and polygons that people draw: where to measure."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dic.errors import CorrelationError
from dic.image.polygons import polygon_mask, read_polygons
from dic.image.read import read_image
from dic.image.region import checked_region


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
            "a mask with white where to measure and black elsewhere",
            "one uniform grey",
            "draw the mask again, or leave --roi out",
        )
    return np.asarray(mask > mask.max() / 2, np.bool_)


def read_region(
    roi: Path | None, polygons: Sequence[str], shape: tuple[int, ...]
) -> NDArray[np.bool_] | None:
    """Return what lies both in the mask image and in the polygons, (height, width), or None without either.

    Raises
    ------
    MeasurementError
        If a file cannot be read, holds no mask or no polygon, or the mask is not as large as the image.
    """
    region = None if roi is None else checked_region(read_mask(roi), shape)
    if polygons:
        drawn = polygon_mask([corners for source in polygons for corners in read_polygons(source)], shape)
        region = drawn if region is None else region & drawn
    return region
