"""Images in the layout of the kernel: a small image as a whole, a large image in bands of its rows.

The layout takes four float32 numbers for each pixel of the reference and one for each pixel of the deformed
image. So of a large image only those rows are laid that the points in work need. Their spline coefficients
and slopes are those of the whole image.
"""

import numpy as np

from dic.correlation import kernel
from dic.image.spline import spline_of_rows
from dic.image.stored import StoredImage, is_large
from dic.typing import Mask

_SAMPLE_PX = 500_000
"""Number of pixels that is enough to estimate the variance that rounding causes."""


class LaidReference:
    """The reference, of which rows are laid for the kernel.

    `usable`, shape (height, width): True for pixels that subsets may use. `order`: degree of the
    interpolating spline. `mean`: mean grey level of the reference, which the kernel subtracts from all
    images. `threads`: number of threads that lay a small image. Each band of a large image is laid by one
    thread.

    `in_bands`: True if the image is so large that it is laid in bands.
    """

    def __init__(self, image: StoredImage, usable: Mask, order: int, mean: float, threads: int) -> None:
        self._image, self._usable, self._order, self._mean = image, usable, order, mean
        self.in_bands = is_large(image.shape)
        self._flat_variance: float | None = None
        self._whole: kernel.KernelReference | None = None
        if self.in_bands:
            self._flat_variance = _flat_variance(image, usable)
        else:
            self._whole = self._laid(slice(0, image.shape[0]), threads)

    def rows(self, first: int, last: int) -> kernel.KernelReference:
        """Return a reference with the rows from `first` to `last` - 1; rows outside the image are ignored."""
        if self._whole is not None:
            return self._whole
        return self._laid(slice(max(0, first), min(self._image.shape[0], last)), 1)

    def _laid(self, rows: slice, threads: int) -> kernel.KernelReference:
        spline = spline_of_rows(self._image, self._order, rows, threads)
        usable, flat = self._usable[rows], self._flat_variance
        return kernel.lay_reference(spline, usable, self._mean, threads, top=rows.start, flat_variance=flat)


class LaidDeformed:
    """A deformed image, of which rows are laid for the kernel; its shape may differ from the reference's.

    `order`: degree of the interpolating spline. `mean`: mean grey level of the reference. `threads`: number
    of threads that lay a small image.

    `height`: height of the image, px.
    """

    def __init__(self, image: StoredImage, order: int, mean: float, threads: int) -> None:
        self._image, self._order, self._mean = image, order, mean
        self.height = image.shape[0]
        self._whole: kernel.Deformed | None = None
        if not is_large(image.shape):
            self._whole = kernel.lay_deformed(image, order, mean, threads)

    def rows(self, first: int, last: int) -> kernel.Deformed:
        """Return an image with the rows from `first` to `last` - 1; rows outside the image are ignored."""
        if self._whole is not None:
            return self._whole
        top = min(max(0, first), self.height - 1)
        rows = slice(top, max(top + 1, min(self.height, last)))
        return kernel.lay_deformed(self._image, self._order, self._mean, rows=rows)


def _flat_variance(image: StoredImage, usable: Mask) -> float:
    """Return the variance of grey levels that rounding alone can cause, from some rows of a large image."""
    height, width = image.shape
    # `flat_variance_of` takes every fourth row of what it is given.
    rows = range(0, height, max(1, height * width // (4 * _SAMPLE_PX)))
    sample = np.concatenate([image.rows(row, row + 1) for row in rows])
    return kernel.flat_variance_of(sample, usable[rows.start : rows.stop : rows.step])
