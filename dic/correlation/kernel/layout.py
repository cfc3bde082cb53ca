"""How images lie in memory for the compiled kernel: flat, padded, in float32.

Vectors read a few elements beyond the pixels of a subset. So rows follow one another without gaps, and there
are spare elements at either end. Grey levels are relative to the reference's mean, which saves digits of
float32.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dic.image.spline import MARGIN, SplineImage
from dic.image.threads import bands_of, in_parallel
from dic.typing import Grey, Mask

Flat = NDArray[np.float32]

_SPARE = 64
"""Elements before the first and after the last row."""

_BAND_PX = 128

_ROUNDING = 1.0 / 12.0
"""Variance that rounding to whole steps adds, in squares of the step between grey levels."""

_STEP = 4.0 / 255.0
"""Step of an 8-bit image in standard deviations of its grey levels, four of which fill its range."""


class Deformed(NamedTuple):
    """A deformed image for the kernel; its shape may differ from the reference's.

    Attributes
    ----------
    c : ndarray of float32, flat
        Coefficients of the spline, divided by the denominators that the kernel leaves out of its weights.
    pitch : int
        Elements from one row to the next.
    origin : int
        Element of the image's first pixel.
    width, height : int
        Of the image, px.
    """

    c: Flat
    pitch: int
    origin: int
    width: int
    height: int


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
    flat_variance : float
        A subset whose grey levels vary no more than this shows rounding and no pattern.
    """

    f: Flat
    fx: Flat
    fy: Flat
    inside: Flat
    pitch: int
    origin: int
    flat_variance: float


def lay_reference(
    spline: SplineImage, slopes: tuple[Grey, Grey], region: Mask, mean: float, threads: int = 1
) -> Reference:
    """Return the reference for the kernel, its grey levels relative to `mean`."""
    height, width = spline.grey.shape
    (f, f_image), (fx, fx_image), (fy, fy_image), (inside, inside_image) = (
        _empty_plane(height, width) for _ in range(4)
    )

    def lay(band: slice) -> None:
        # Write in place: of 20 megapixels every copy takes 80 MB.
        own = region[band]
        np.subtract(spline.grey[band], np.float32(mean), out=f_image[band], where=own)
        np.copyto(fx_image[band], slopes[0][band], where=own)
        np.copyto(fy_image[band], slopes[1][band], where=own)
        np.copyto(inside_image[band], own)

    in_parallel(lay, bands_of(height, _BAND_PX), threads)
    pitch, origin = _pitch_and_origin(width)
    return Reference(f, fx, fy, inside, pitch, origin, _flat_variance(spline.grey, region))


def _flat_variance(grey: Grey, region: Mask) -> float:
    """Return the variance that rounding alone may give the grey levels of a subset in the region.

    The unit of the grey levels is not known. The step between them is assumed to be that of an 8-bit image,
    and at least 1 if all grey levels are whole numbers.
    """
    # Every fourth row suffices.
    sample = grey[::4][region[::4]]
    if not sample.size:
        return 0.0
    whole = bool((sample == np.rint(sample)).all())
    step = max(_STEP * float(sample.std(dtype=np.float64)), 1.0 if whole else 0.0)
    return _ROUNDING * step**2


def lay_coefficients(spline: SplineImage, mean: float, threads: int = 1) -> Deformed:
    """Return a deformed image for the kernel, its grey levels relative to the reference's `mean`."""
    factor = np.float32(1.0 / {3: 6.0, 5: 120.0}[spline.order] ** 2)
    flat = np.zeros(spline.coefficients.size + 2 * _SPARE, np.float32)
    plane = flat[_SPARE:-_SPARE].reshape(spline.coefficients.shape)

    def lay(band: slice) -> None:
        np.subtract(spline.coefficients[band], np.float32(mean), out=plane[band])
        plane[band] *= factor

    in_parallel(lay, bands_of(len(plane), _BAND_PX), threads)
    height, width = spline.grey.shape
    return Deformed(flat, *_pitch_and_origin(width), width, height)


def _pitch_and_origin(width: int) -> tuple[int, int]:
    """Return the pitch of an image of this width, and the element of its first pixel."""
    pitch = width + 2 * MARGIN
    return pitch, _SPARE + MARGIN * pitch + MARGIN


def _empty_plane(height: int, width: int) -> tuple[Flat, Grey]:
    """Return a flat plane of zeros and the view of it that holds the image."""
    flat = np.zeros((height + 2 * MARGIN) * (width + 2 * MARGIN) + 2 * _SPARE, np.float32)
    plane = flat[_SPARE:-_SPARE].reshape(height + 2 * MARGIN, width + 2 * MARGIN)
    return flat, plane[MARGIN:-MARGIN, MARGIN:-MARGIN]
