"""Find where a specimen's surface is, by correlating the reference images of two cameras with each other."""

import numpy as np

from dic.calibration.calibration import Calibration
from dic.correlation.correlator import Correlator
from dic.correlation.settings import CorrelationSettings
from dic.errors import CorrelationError
from dic.out_of_plane.reference_surface import ReferenceSurface, reference_surface
from dic.typing import Float, Grey

_SETTINGS = CorrelationSettings(subset_px=41, step_px=20, shape="quadratic")
"""Settings of the correlation; a few large subsets are enough, because only a plane is fitted to them."""


def match_references(
    references: tuple[Grey, Grey], calibrations: tuple[Calibration, Calibration]
) -> ReferenceSurface:
    """Return the plane, in the grid's axes, of the specimen's surface in the reference images of two cameras.

    If the two images cannot be correlated, the result gives the reason instead of the plane.
    """
    (first, second), (one, other) = references, calibrations
    if one.pinhole is None or other.pinhole is None:
        return ReferenceSurface(problem="a calibration knows no camera centre")
    height, width = first.shape
    y, x = np.mgrid[:height, :width]
    pixels = np.column_stack([x.ravel(), y.ravel()]).astype(np.float64)
    region = one.inside(pixels).reshape(height, width)
    try:
        correlator = Correlator(first, region, _SETTINGS, clip=False, copy=False)
        hint = _homography(one, other)
        field = correlator.correlate(_of_shape(second, (height, width)), hint=hint)
    except CorrelationError as error:
        return ReferenceSurface(problem=f"the reference images of both cameras do not match ({error.got})")
    return reference_surface(field, (one, other))


def _homography(first: Calibration, second: Calibration) -> Float:
    """Return the homography from the first camera's image of the grid's plane to the second camera's."""
    import cv2

    if first.pinhole is None or second.pinhole is None:
        raise ValueError("a calibration knows no camera centre")
    seen = [pinhole.project(first.grid.xy_mm) for pinhole in (first.pinhole, second.pinhole)]
    known = np.isfinite(np.hstack(seen)).all(axis=1)
    return np.asarray(cv2.findHomography(seen[0][known], seen[1][known])[0], np.float64)


def _of_shape(image: Grey, shape: tuple[int, int]) -> Grey:
    """Return the image with another shape: cut off, or filled with 0, at the right and at the bottom."""
    if image.shape == shape:
        return image
    filled = np.zeros(shape, image.dtype)
    rows, columns = (min(a, b) for a, b in zip(image.shape, shape, strict=True))
    filled[:rows, :columns] = image[:rows, :columns]
    return filled
