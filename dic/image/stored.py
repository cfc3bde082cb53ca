"""Images that stay in memory as they are stored, with 8 or 16 bit, until some of their rows are used.

The correlation computes with float32. A whole image in float32 takes four times as much memory as its file
with 8 bit, and each step of the preparation takes as much again. So large images keep the type of their file,
and only the rows that are used at the moment are converted.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dic.image.threads import bands_of
from dic.typing import Grey, Mask

WHOLE_PX = 12_000_000
"""Largest number of pixels of an image that is prepared as a whole; larger images are prepared in bands."""

_BAND_PX = 256


def is_large(shape: tuple[int, ...]) -> bool:
    """Return True if images of `shape` (height, width) are prepared in bands of rows."""
    return shape[0] * shape[1] > WHOLE_PX


def everywhere(shape: tuple[int, ...]) -> Mask:
    """Return a read-only mask of `shape` that is True everywhere; it repeats one element in memory."""
    return np.broadcast_to(np.True_, shape)


@dataclass(frozen=True, eq=False)
class StoredImage:
    """An image whose rows are converted to float32 and smoothed when they are used."""

    stored: NDArray[Any]
    """Shape (height, width). Grey levels as stored."""
    taps: tuple[float, ...] = (1.0,)
    """Weights of the filter that smooths the image along x and along y. The image is mirrored at its edges.
    """

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width, px."""
        height, width = self.stored.shape
        return height, width

    @property
    def is_ready(self) -> bool:
        """True if the stored grey levels are those that are used: float32, and not to be smoothed."""
        return len(self.taps) == 1 and self.stored.dtype == np.float32

    def rows(self, first: int, last: int) -> Grey:
        """Return the smoothed grey levels of the rows from `first` to `last` - 1."""
        return self.part(slice(first, last), slice(0, self.shape[1]))

    def part(self, rows: slice, columns: slice) -> Grey:
        """Return the smoothed grey levels of some neighbouring rows and columns."""
        if len(self.taps) == 1:
            return np.ascontiguousarray(self.stored[rows, columns], np.float32)
        import cv2

        reach, taps = len(self.taps) // 2, np.array(self.taps, np.float32)
        top, left = max(0, rows.start - reach), max(0, columns.start - reach)
        around = self.stored[top : rows.stop + reach, left : columns.stop + reach]
        grey = np.ascontiguousarray(around, np.float32)
        smooth = cv2.sepFilter2D(grey, cv2.CV_32F, taps, taps, borderType=cv2.BORDER_REFLECT_101)
        own = smooth[rows.start - top : rows.stop - top, columns.start - left : columns.stop - left]
        return np.ascontiguousarray(own, np.float32)

    def mean(self) -> float:
        """Return the mean grey level."""
        if self.is_ready:
            return float(self.stored.mean(dtype=np.float64))
        height, width = self.shape
        sums = [self.rows(band.start, band.stop).sum(dtype=np.float64) for band in bands_of(height, _BAND_PX)]
        return float(sum(sums)) / (height * width)

    def reduced(self, size: tuple[int, int]) -> Grey:
        """Return the image reduced to `size` (width, height); each pixel is the mean of an area."""
        import cv2

        if self.is_ready:
            return np.asarray(cv2.resize(self.stored, size, interpolation=cv2.INTER_AREA), np.float32)
        height = self.shape[0]
        narrow = np.empty((height, size[0]), np.float32)
        for band in bands_of(height, _BAND_PX):
            narrow_size = (size[0], band.stop - band.start)
            narrow[band] = cv2.resize(
                self.rows(band.start, band.stop), narrow_size, interpolation=cv2.INTER_AREA
            )
        return np.asarray(cv2.resize(narrow, size, interpolation=cv2.INTER_AREA), np.float32)

    def turned(self, quarters: int) -> "StoredImage":
        """Return the image turned by `numpy.rot90`, without a copy."""
        return StoredImage(np.rot90(self.stored, quarters), self.taps)
