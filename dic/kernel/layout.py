"""How the compiled kernel wants its images: flat, padded, in float32, all with one pitch.

Vectors read a little past the pixels they are for, so rows follow one another without gaps and there is slack
at either end. Grey levels are relative to their mean: float32 then has digits to spare.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dic.spline import MARGIN, SplineImage

Flat = NDArray[np.float32]
Grey = NDArray[np.float32]

_SLACK = 64


class Reference(NamedTuple):
    """The reference image for the kernel.

    Attributes
    ----------
    f, fx, fy : ndarray of float32, flat
        Grey level and its derivatives, zero outside the region of interest.
    inside : ndarray of float32, flat
        1 in the region of interest, 0 outside.
    pitch : int
        Elements from one row to the next.
    origin : int
        Element of the image's first pixel.
    width, height : int
        Of the image, px.
    """

    f: Flat
    fx: Flat
    fy: Flat
    inside: Flat
    pitch: int
    origin: int
    width: int
    height: int


def lay_reference(
    spline: SplineImage, slopes: tuple[Grey, Grey], region: NDArray[np.bool_], mean: float
) -> Reference:
    """Return the reference for the kernel, its grey levels relative to `mean`."""
    height, width = spline.grey.shape
    weight = region.astype(np.float32)
    planes = [(spline.grey - np.float32(mean)) * weight, slopes[0] * weight, slopes[1] * weight, weight]
    pitch = width + 2 * MARGIN
    flat = [_flatten(np.pad(plane, MARGIN)) for plane in planes]
    origin = _SLACK + MARGIN * pitch + MARGIN
    return Reference(flat[0], flat[1], flat[2], flat[3], pitch, origin, width, height)


def lay_coefficients(spline: SplineImage, mean: float) -> Flat:
    """Return a deformed image's coefficients in the reference's layout, relative to `mean`.

    They are divided by the denominators of the B-spline's weights, which the kernel leaves out.
    """
    denominator = {3: 6.0, 5: 120.0}[spline.order] ** 2
    return _flatten((spline.coefficients - np.float32(mean)) * np.float32(1.0 / denominator))


def _flatten(plane: Grey) -> Flat:
    flat = np.zeros(plane.size + 2 * _SLACK, np.float32)
    flat[_SLACK:-_SLACK] = plane.ravel()
    return flat
