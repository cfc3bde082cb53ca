"""The layout of images in memory for the compiled kernel: flat padded arrays of float32.

Vectors of 8 or 16 elements read a few elements beyond the pixels of a subset. So rows follow one another
without gaps, and there are spare elements at both ends of the array. The mean grey level of the reference is
subtracted from all grey levels, which reduces rounding errors in float32.

Either a whole image is laid, or a band of its rows. The indices of elements count from the first row of the
whole image in both cases, so the kernel does not distinguish them.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dic.image.spline import MARGIN, SplineImage
from dic.image.threads import bands_of, in_parallel
from dic.typing import Grey, Mask

Flat = NDArray[np.float32]

SPARE = 64
"""Number of spare elements before the first row and after the last row of an image."""

_BAND_PX = 128

BEYOND = 2**30
"""A row that is beyond every image."""

_ROUNDING = 1.0 / 12.0
"""Variance that rounding adds to grey levels, in units of the squared step between grey levels."""

_STEP = 4.0 / 255.0
"""Assumed step between grey levels, in standard deviations of the grey levels.

The number is the step of an 8-bit image whose range of grey levels is four standard deviations.
"""


class Deformed(NamedTuple):
    """A deformed image for the kernel; its shape may differ from the reference's."""

    c: Flat
    """Coefficients of the spline, divided by the denominators of the B-spline weights. So the weights in the
    kernel need no denominators.
    """
    pitch: int
    """Number of elements from one row to the next."""
    origin: int
    """Index of the element that belongs to the image's first pixel."""
    width: int
    height: int
    """Size of the whole image, px."""
    top: int
    bottom: int
    """The first row that is laid, and the row after the last one. If the band ends at an edge of the image,
    the number lies far beyond this edge, because every point that is in view is then laid.
    """


class KernelReference(NamedTuple):
    """The reference image for the kernel."""

    f: Flat
    fx: Flat
    fy: Flat
    """Grey levels and their derivatives along x and y, which are 0 outside the region of interest."""
    inside: Flat
    """The number 1 at pixels in the region of interest, and 0 outside."""
    pitch: int
    """Number of elements from one row to the next."""
    origin: int
    """Index of the element that belongs to the image's first pixel."""
    flat_variance: float
    """Variance of grey levels that rounding alone can cause. A subset with a smaller variance has no pattern.
    """


def lay_reference(
    spline: SplineImage,
    region: Mask,
    mean: float,
    threads: int = 1,
    *,
    top: int = 0,
    flat_variance: float | None = None,
) -> KernelReference:
    """Return the reference image for the kernel, with `mean` subtracted from its grey levels.

    `spline`: the image, or a band of its rows. `top`: the first row of the band. `flat_variance`: result of
    `flat_variance_of` for the whole image. By default it is computed from `spline.grey`.
    """
    height, width = spline.shape
    (f, f_image), (fx, fx_image), (fy, fy_image), (inside, inside_image) = (
        _empty_plane(height, width) for _ in range(4)
    )

    def lay(band: slice) -> None:
        # Write in place, because each copy of an image with 20 megapixels takes 80 MB.
        own, slopes = region[band], spline.gradient_of(band)
        np.subtract(spline.grey_of(band), np.float32(mean), out=f_image[band], where=own)
        np.copyto(fx_image[band], slopes[0], where=own)
        np.copyto(fy_image[band], slopes[1], where=own)
        np.copyto(inside_image[band], own)

    in_parallel(lay, bands_of(height, _BAND_PX), threads)
    if flat_variance is None:
        flat_variance = flat_variance_of(spline.grey, region)
    return KernelReference(f, fx, fy, inside, *pitch_and_origin(width, top), flat_variance)


def flat_variance_of(grey: Grey, region: Mask) -> float:
    """Return the variance of a subset's grey levels that rounding alone can cause.

    The function does not know the scale of the grey levels. The step between grey levels is assumed to be the
    step of an 8-bit image, and at least 1 if all grey levels are whole numbers.
    """
    # Every fourth row is enough for an estimate.
    sample = grey[::4][region[::4]]
    if not sample.size:
        return 0.0
    whole = bool((sample == np.rint(sample)).all())
    step = max(_STEP * float(sample.std(dtype=np.float64)), 1.0 if whole else 0.0)
    return _ROUNDING * step**2


def pitch_and_origin(width: int, top: int) -> tuple[int, int]:
    """Return the pitch of an image of the given width, and the index of its first pixel's element.

    If the image is laid from the row `top` on, the element of its first pixel is before the array's first
    element.
    """
    pitch = width + 2 * MARGIN
    return pitch, SPARE + (MARGIN - top) * pitch + MARGIN


def _empty_plane(height: int, width: int) -> tuple[Flat, Grey]:
    """Return a flat array of zeros, and a view of the part of this array that holds the image."""
    flat = np.zeros((height + 2 * MARGIN) * (width + 2 * MARGIN) + 2 * SPARE, np.float32)
    plane = flat[SPARE:-SPARE].reshape(height + 2 * MARGIN, width + 2 * MARGIN)
    return flat, plane[MARGIN:-MARGIN, MARGIN:-MARGIN]
