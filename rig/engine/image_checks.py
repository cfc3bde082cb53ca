"""Compare light, focus and motion blur of each image with the reference image, and detect frozen pictures.

The measures use every fourth row of pixels, so an image of 4 megapixels takes a few milliseconds. The
measures are compared with those of the reference image. `dic.assess_quality` measures the blur in pixels and
the noise, but takes seconds per image. `rig check` uses it before a run.
"""

import math
import zlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.errors import DeviceFault
from drivers.interfaces import CameraInfo, Frame
from rig.protocol.images import Images

_EVERY_ROW = 4
_LEAST_PX = 10_000
"""Smallest number of pixel pairs for a sharpness. With fewer pairs it would depend too much on chance."""
_BASE_PX = 2
"""Distance in px between the two pixels of a pair. Direct neighbours would differ mostly by noise."""


@dataclass(frozen=True)
class Measures:
    """Measures of one image."""

    mean: float  # mean grey level
    saturated: float  # fraction of the pixels at the highest grey level
    # root mean square of the difference between the two pixels of a pair in a row or in a column, divided by
    # the mean grey level. NaN for a black or a too small image.
    sharpness_x: float
    sharpness_y: float
    # True if all pixels have the same grey level, so that sharpness and frozen pictures cannot be judged
    uniform: bool
    digest: int  # CRC-32 of all pixels

    @property
    def sharpness(self) -> float:
        """One value for the sharpness in both directions."""
        return math.hypot(self.sharpness_x, self.sharpness_y)


def measure(image: NDArray[np.uint8] | NDArray[np.uint16], bits: int) -> Measures:
    """Measure an image whose pixels have `bits` significant bits."""
    rows = image[::_EVERY_ROW]
    below = image[_BASE_PX::_EVERY_ROW]
    mean = float(rows.mean(dtype=np.float64))
    return Measures(
        mean=mean,
        saturated=float(np.count_nonzero(rows >= (1 << bits) - 1) / rows.size),
        sharpness_x=_relative(rows[:, _BASE_PX:], rows[:, :-_BASE_PX], mean),
        sharpness_y=_relative(below, rows[: len(below)], mean),
        uniform=bool(rows.min() == rows.max()),
        digest=zlib.crc32(np.ascontiguousarray(image).data),
    )


def _relative(first: NDArray[np.generic], second: NDArray[np.generic], mean: float) -> float:
    if first.size < _LEAST_PX or mean == 0.0:
        return math.nan
    difference = np.subtract(first, second, dtype=np.float32).ravel()
    return math.sqrt(float(np.dot(difference, difference)) / difference.size) / mean


class ImageChecks:
    """The checks of the images of one camera during one run.

    `limits` are the limits that the protocol declares.
    """

    def __init__(self, info: CameraInfo, limits: Images) -> None:
        self._info = info
        self._limits = limits
        self._reference: Measures | None = None
        self._last: Measures | None = None
        self._sequence: int | None = None

    def reopened(self) -> None:
        """Forget the number of the last frame, because a reopened camera begins its numbers again."""
        self._sequence = None

    def not_fresh(self, frame: Frame, asked_s: float) -> tuple[str, str, str] | None:
        """Return expected result, actual result and remedy if a frame may be old or damaged, else None."""
        if not frame.exposed_s >= asked_s:
            return (
                "an image exposed after it was asked for",
                f"one exposed {asked_s - frame.exposed_s:.3f} s before",
                "use a driver that discards waiting images, such as v4l2 or aravis",
            )
        if frame.flags:
            return (
                "an image without error flags",
                f"one with the flags {frame.flags:#x}",
                "check the camera's cable, or let fewer cameras share its bus",
            )
        if self._sequence is not None and frame.sequence <= self._sequence:
            return (
                f"an image with a number above {self._sequence}",
                f"number {frame.sequence}",
                "check the camera's driver, which delivers images twice or out of order",
            )
        return None

    def require_format(self, frame: Frame, device: str, step: str) -> None:
        """Raise `DeviceFault` if a frame has another format than the camera announced."""
        dtype = np.uint8 if self._info.bits <= 8 else np.uint16
        shape = (self._info.height_px, self._info.width_px)
        if frame.image.shape != shape or frame.image.dtype != dtype:
            raise DeviceFault(
                device,
                step,
                f"an image of {shape[1]} x {shape[0]} px as {np.dtype(dtype)}",
                f"shape {frame.image.shape} as {frame.image.dtype}",
                "mend the driver, which announces a format that it does not deliver",
            )

    def is_frozen(self, measured: Measures) -> bool:
        """Return True if the pixels equal those of the image before. Noise makes good images differ."""
        return not measured.uniform and self._last is not None and measured.digest == self._last.digest

    def measure(self, frame: Frame) -> Measures:
        """Measure a frame with the camera's number of bits."""
        return measure(frame.image, self._info.bits)

    def findings(self, measured: Measures) -> list[str]:
        """Return one sentence for each limit that an image violates."""
        limits, found = self._limits, []
        if measured.saturated > limits.saturated_max:
            found.append(
                f"{measured.saturated:.1%} of the pixels are saturated, more than images.saturated_max, "
                f"{limits.saturated_max:g}"
            )
        first = self._reference
        if first is None or first.uniform:
            return found
        change = measured.mean / first.mean - 1.0
        if abs(change) > limits.light_change_max:
            found.append(
                f"the light changed by {change:+.0%} since the reference, more than images.light_change_max, "
                f"{limits.light_change_max:g}"
            )
        return found + self._blur(measured, first)

    def _blur(self, measured: Measures, first: Measures) -> list[str]:
        found = []
        share = measured.sharpness / first.sharpness
        if share < self._limits.sharpness_min:
            found.append(
                f"the sharpness is {share:.0%} of the reference's, less than images.sharpness_min, "
                f"{self._limits.sharpness_min:g}"
            )
        if measured.sharpness_x and measured.sharpness_y and first.sharpness_x and first.sharpness_y:
            ratio = measured.sharpness_x / measured.sharpness_y * first.sharpness_y / first.sharpness_x
            if max(ratio, 1.0 / ratio) > self._limits.blur_ratio_max:
                along = "x" if ratio < 1.0 else "y"
                found.append(
                    f"the image is blurred along {along}, by a ratio of {max(ratio, 1.0 / ratio):.2f}, more "
                    f"than images.blur_ratio_max, {self._limits.blur_ratio_max:g}"
                )
        return found

    def accept(self, frame: Frame, measured: Measures, *, reference: bool) -> None:
        """Store the measures of a recorded image. The first image of the reference step becomes the
        reference."""
        self._sequence = frame.sequence
        self._last = measured
        if reference and self._reference is None:
            self._reference = measured
