"""Interpolate images by B-splines, and compute the exact derivatives of the splines at the pixels.

A spline of odd degree interpolates the grey levels exactly. The spline's coefficients follow from the image
by a recursive filter (M. Unser, "Splines: a perfect fit for signal and image processing", IEEE Signal
Processing Magazine 16(6), 1999). This module applies the filter's truncated impulse response as a separable
convolution.
"""

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from dic.image.stored import StoredImage
from dic.image.threads import bands_of, in_parallel

MARGIN = 3
"""Number of coefficients beyond each image edge, which is the number that the quintic spline needs."""

_BAND_PX = 256
"""Height of the bands of rows in which images are filtered, px."""

_POLES = {3: 0.267949, 5: 0.430575}
"""Largest pole of the spline's recursive filter, for each degree."""

_TAPS = {3: 12, 5: 18}
"""Half-length of the impulse response for each degree; values farther out are below 1e-7 of the centre's."""

# The B-spline of each degree at the pixels and half-way between pixels, and its derivative at the pixels with
# the sign reversed. The last digits are those of de Boor's recursion, with which SciPy computes these values.
# An import of scipy.interpolate takes longer than the correlation of a small image.
_AT_PIXELS = {
    3: np.array([0.16666666666666666, 0.6666666666666666, 0.16666666666666666]),
    5: np.array(
        [
            0.008333333333333333,
            0.21666666666666665,
            0.5499999999999999,
            0.21666666666666665,
            0.008333333333333333,
        ]
    ),
}
_HALF_WAY = {
    3: np.array([0.020833333333333332, 0.47916666666666663, 0.47916666666666663, 0.020833333333333332]),
    5: np.array(
        [
            0.00026041666666666666,
            0.061718749999999996,
            0.4380208333333333,
            0.4380208333333333,
            0.061718749999999996,
            0.00026041666666666666,
        ]
    ),
}
_SLOPES = {
    3: np.array([-0.5, -0.0, 0.5]),
    5: np.array(
        [-0.041666666666666664, -0.41666666666666663, -0.0, 0.41666666666666663, 0.041666666666666664]
    ),
}


@dataclass(frozen=True)
class SplineImage:
    """An image, or a band of its rows, that is interpolated by a B-spline."""

    order: int
    """Degree of the spline: 3 (cubic) or 5 (quintic)."""
    image: StoredImage
    """The whole image."""
    top: int
    """The first row of the band."""
    coefficients: NDArray[np.float32]
    """Shape (height + 2 * MARGIN, width + 2 * MARGIN). The coefficient of the band's pixel (row, column) is
    at ``[row + MARGIN, column + MARGIN]``.
    """

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of the band, px."""
        height, width = self.coefficients.shape
        return height - 2 * MARGIN, width - 2 * MARGIN

    @property
    def grey(self) -> NDArray[np.float32]:
        """Grey levels at the pixels, shape (height, width)."""
        return self.grey_of(slice(0, self.shape[0]))

    def grey_of(self, rows: slice) -> NDArray[np.float32]:
        """Return the grey levels of some rows, which count from the band's first row."""
        return self.image.rows(self.top + rows.start, self.top + rows.stop)

    def gradient_of(self, rows: slice) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return the derivatives along x and along y at the pixels of some rows, in grey levels per px."""
        import cv2

        samples, slopes = _AT_PIXELS[self.order], _SLOPES[self.order]
        coefficients = self.coefficients[rows.start : rows.stop + 2 * MARGIN]
        along_x, along_y = (
            cv2.sepFilter2D(coefficients, cv2.CV_32F, across, down)[MARGIN:-MARGIN, MARGIN:-MARGIN]
            for across, down in ((slopes, samples), (samples, slopes))
        )
        return np.asarray(along_x, np.float32), np.asarray(along_y, np.float32)

    def gradient(self, threads: int = 1) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return the spline's derivatives along x and along y at every pixel, in grey levels per px."""
        along_x, along_y = (np.empty(self.shape, np.float32) for _ in range(2))

        def work(band: slice) -> None:
            along_x[band], along_y[band] = self.gradient_of(band)

        in_parallel(work, bands_of(self.shape[0], _BAND_PX), threads)
        return along_x, along_y


def edge_reach_px(order: int) -> int:
    """Return how far from a step of grey levels the spline of degree `order` still oscillates, in px.

    The oscillation decreases from pixel to pixel by the factor of the spline's largest pole, which is 0.268
    for the cubic and 0.431 for the quintic spline (Unser 1999, table 1). Beyond the returned distance, the
    oscillation is less than 1.5 % of its value at the step.
    """
    return math.ceil(math.log(0.015) / math.log(_POLES[order]))


def spline_image(grey: NDArray[np.float32], order: int, threads: int = 1) -> SplineImage:
    """Return the B-spline of degree `order` through the grey levels; the image is mirrored at its edges."""
    grey = np.ascontiguousarray(grey, np.float32)
    return spline_of_rows(StoredImage(grey), order, slice(0, len(grey)), threads)


def spline_of_rows(image: StoredImage, order: int, rows: slice, threads: int = 1) -> SplineImage:
    """Return the B-spline of some rows of an image, with the coefficients that it has in the whole image.

    `image`: the image, which is mirrored at its edges. `order`: degree of the spline, 3 or 5. `rows`: the
    rows of the band.
    """
    import cv2

    taps = inverse_filter(order).astype(np.float32)
    height, width = image.shape
    reach = len(taps) // 2
    # Rows beyond the edges of the image are filled below.
    first, last = max(0, rows.start - MARGIN), min(height, rows.stop + MARGIN)
    padded = np.empty((rows.stop - rows.start + 2 * MARGIN, width + 2 * MARGIN), np.float32)
    top = rows.start - MARGIN

    def work(band: slice) -> None:
        # Filter `reach` extra rows on either side, and drop these rows, because these rows lack neighbours.
        start, stop = first + band.start, first + band.stop
        above = max(0, start - reach)
        filtered = cv2.sepFilter2D(
            image.rows(above, min(height, stop + reach)),
            cv2.CV_32F,
            taps,
            taps,
            borderType=cv2.BORDER_REFLECT_101,
        )
        padded[start - top : stop - top] = cv2.copyMakeBorder(
            filtered[start - above : stop - above], 0, 0, MARGIN, MARGIN, cv2.BORDER_REFLECT_101
        )

    in_parallel(work, bands_of(last - first, _BAND_PX), threads)
    for k in range(1, MARGIN + 1):
        if rows.start - k < 0:
            padded[MARGIN - k] = padded[MARGIN + k - 2 * rows.start]
        if rows.stop - 1 + k >= height:
            padded[-MARGIN - 1 + k] = padded[2 * (height - 1) - (rows.stop - 1 + k) - top]
    return SplineImage(order, image, rows.start, padded)


@cache
def halfway_noise_gain(order: int, smoothing: tuple[float, ...] = (1.0,)) -> float:
    """Return the factor by which interpolation half-way between pixels changes the variance of noise.

    The noise was white before a filter with the taps `smoothing` was applied along rows and along columns.
    The factor is the sum of the squared weights of the pixels in a row, relative to the same sum for a
    position at a pixel.
    """
    return _power(np.convolve(inverse_filter(order), _HALF_WAY[order]), smoothing) / _power(
        np.ones(1), smoothing
    )


@cache
def slope_noise_gain(order: int, smoothing: tuple[float, ...] = (1.0,)) -> float:
    """Return the variance of the spline's derivative at a pixel, if the pixels have noise of variance 1.

    The noise was white before a filter with the taps `smoothing` was applied along rows and along columns.
    """
    return _power(slope_taps(order), smoothing) / _power(np.ones(1), smoothing)


def _power(taps: NDArray[np.float64], smoothing: tuple[float, ...]) -> float:
    """Return the sum of the squared taps of two filters in succession."""
    return float(np.sum(np.convolve(taps, np.array(smoothing)) ** 2))


def slope_taps(order: int) -> NDArray[np.float64]:
    """Return the weights of the pixels of a row in the spline's derivative at the middle pixel.

    The spline Σ c_k β(x - k) with coefficients c_k has the derivative Σ c_k β'(-k) at x = 0. Since β'(-k) is
    -β'(k), the sign of β' is reversed.
    """
    return np.convolve(inverse_filter(order), _SLOPES[order])


@cache
def inverse_filter(order: int) -> NDArray[np.float64]:
    """Return the impulse response of the filter that computes B-spline coefficients from grey levels."""
    if order not in (3, 5):
        raise ValueError(f"spline order: expected 3 or 5, got {order}")
    length = 512
    samples = _AT_PIXELS[order]
    ring = np.zeros(length)
    half = samples.size // 2
    ring[: half + 1] = samples[half:]
    ring[-half:] = samples[:half]
    response = np.fft.irfft(1.0 / np.fft.rfft(ring), length)
    taps = _TAPS[order]
    return np.concatenate([response[-taps:], response[: taps + 1]])
