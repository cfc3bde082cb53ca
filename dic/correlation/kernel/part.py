"""Parts of images for the kernel: the reference's around some points, and the deformed image's around them.

A live measurement correlates the same few points in every image of a camera. So it lays only the part of the
image that shows them, in memory that is used again. The coefficients are those of the whole image: the
filter also reads the pixels around the part, and the image is mirrored at its edges.

The coordinates of a laid part count from its own first pixel. For the kernel a part is an image of its own.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dic.correlation.kernel.coefficients import DENOMINATORS, filter_rows, mirrored
from dic.correlation.kernel.layout import BEYOND, SPARE, Deformed, Flat, KernelReference
from dic.image.spline import MARGIN, inverse_filter
from dic.typing import Indices

_VECTOR = 16
"""Number of elements of the longest vector of the kernel."""

_GROUP = 3
"""The filter takes this number of taps at a time."""

_ROOM = 1.3
"""Memory is made larger than needed by this factor, so that a growing part seldom needs new memory."""


class Part(NamedTuple):
    """Some neighbouring rows and columns of an image."""

    top: int
    bottom: int
    left: int
    right: int
    """The first row and the row after the last one, and the same of the columns."""

    def within(self, shape: tuple[int, ...]) -> "Part":
        """Return what lies inside an image of this height and width."""
        height, width = shape
        top, left = min(max(0, self.top), height), min(max(0, self.left), width)
        return Part(top, max(top, min(height, self.bottom)), left, max(left, min(width, self.right)))

    @property
    def pixels(self) -> int:
        """Number of pixels."""
        return (self.bottom - self.top) * (self.right - self.left)


def part_of_reference(reference: KernelReference, part: Part) -> KernelReference:
    """Return a part of the reference, whose coordinates count from the part's first pixel."""
    height, width = part.bottom - part.top, part.right - part.left
    first = reference.origin + part.top * reference.pitch + part.left
    elements = first + reference.pitch * np.arange(height)[:, None] + np.arange(width)
    # The kernel reads a vector at the end of a row to its last element, and multiplies the rest by 0.
    pitch = width + _VECTOR
    planes = []
    for plane in (reference.f, reference.fx, reference.fy, reference.inside):
        flat = np.zeros(height * pitch + 2 * SPARE, np.float32)
        flat[SPARE:-SPARE].reshape(height, pitch)[:, :width] = plane[elements]
        planes.append(flat)
    f, fx, fy, inside = planes
    return reference._replace(f=f, fx=fx, fy=fy, inside=inside, pitch=pitch, origin=SPARE)


class PartMemory:
    """Memory for the part of the deformed images that shows some points.

    `order`: degree of the spline, 3 or 5. `mean`: mean grey level of the reference. `smoothing`: taps of the
    filter that smooths the images.
    """

    def __init__(self, order: int, mean: float, smoothing: tuple[float, ...]) -> None:
        response = np.convolve(inverse_filter(order), smoothing)
        half = response[len(response) // 2 :]
        more = -(len(half) - 1) % _GROUP
        self._taps: Flat = np.pad(half, (0, more)).astype(np.float32)
        self._mean, self._factor = float(mean), 1.0 / DENOMINATORS[order] ** 2
        self._grey, self._coefficients, self._line = (np.zeros(0, np.float32) for _ in range(3))
        self._count: Indices = np.arange(0)

    @property
    def reach_px(self) -> int:
        """Number of pixels around a part that determine its coefficients."""
        return len(self._taps) - 1 + MARGIN

    def lay(self, image: NDArray[Any], part: Part) -> Deformed:
        """Return a part of a deformed image, in the part's own coordinates, until the next call."""
        reach = self.reach_px
        around = Part(part.top - reach, part.bottom + reach, part.left - reach, part.right + reach)
        inside = around.within(image.shape)
        height, width = part.bottom - part.top + 2 * MARGIN, part.right - part.left + 2 * MARGIN
        self._make_room(inside.pixels, height * width + 2 * SPARE, width + height + 2 * reach)
        grey = self._grey[: inside.pixels].reshape(inside.bottom - inside.top, inside.right - inside.left)
        np.copyto(grey, image[inside.top : inside.bottom, inside.left : inside.right])
        rows, columns = self._indices(around, inside, image.shape)
        plane = self._coefficients[SPARE : SPARE + height * width].reshape(height, width)
        at, line = (0, inside.left - around.left), self._line[: len(columns)]
        filter_rows(grey, rows, columns, self._taps, self._mean, self._factor, plane, at, line)
        origin = SPARE + MARGIN * width + MARGIN
        size = part.right - part.left, part.bottom - part.top
        return Deformed(self._coefficients, width, origin, *size, -BEYOND, BEYOND)

    def _indices(self, around: Part, inside: Part, shape: tuple[int, ...]) -> tuple[Indices, Indices]:
        """Return the place in the grey levels of each row and column that the filter reaches."""
        height, width = shape
        if around == inside:
            return self._count[: around.bottom - around.top], self._count[: around.right - around.left]
        return (
            mirrored(around.top, around.bottom, height) - inside.top,
            mirrored(around.left, around.right, width) - inside.left,
        )

    def _make_room(self, grey: int, coefficients: int, line: int) -> None:
        if grey > len(self._grey):
            self._grey = np.zeros(int(_ROOM * grey), np.float32)
        if coefficients > len(self._coefficients):
            self._coefficients = np.zeros(int(_ROOM * coefficients), np.float32)
        if line > len(self._line):
            self._line = np.zeros(int(_ROOM * line), np.float32)
            self._count = np.arange(len(self._line))
