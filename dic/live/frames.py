"""Checks of a frame that need no correlation: is it a new one, overexposed, or faint?"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dic.correlation.kernel import Part
from dic.live.tracking import Tracker
from dic.typing import Float, Indices

_SAMPLE_PX = 32
"""Width of the squares whose pixels are compared with those of the last frame."""

_SKIP_PX = 2
"""Only each second row and column of a patch is needed for its contrast."""
_FEWER_BITS = (1023, 4095, 16383)
_EIGHT_BIT = 255


class FrameChecks:
    """Compare each frame with the last one, count saturated pixels, and measure the contrast.

    `reference`: the reference image. `tracker`: the points as they are followed. `groups`: numbers of the
    points, patch by patch, that saturated pixels disturb together.
    """

    def __init__(self, reference: NDArray[Any], tracker: Tracker, groups: Sequence[Indices]) -> None:
        self._reference, self._tracker = reference, tracker
        self._numbers = np.concatenate(groups)
        self._starts = np.cumsum([0, *(len(own) for own in groups)])[:-1]
        self._at_rest = self._parts(reference.shape)
        self._level: int | None = None
        self._usual: Float | None = None
        self._usual_contrasts = _contrasts(reference, self._at_rest)
        self._last: list[tuple[Part, NDArray[Any]]] = []

    def repeated(self, image: NDArray[Any]) -> bool:
        """Return True if a frame has the same grey levels as the last one at all gauges.

        The noise of a camera makes two frames differ, also if nothing moves.
        """
        return bool(self._last) and all(
            np.array_equal(image[part.top : part.bottom, part.left : part.right], grey)
            for part, grey in self._last
        )

    def keep(self, image: NDArray[Any]) -> None:
        """Keep a square of each tile for the comparison with the next frame."""
        self._last = []
        for window in self._tracker.windows:
            y, x = (window.top + window.bottom) // 2, (window.left + window.right) // 2
            half = _SAMPLE_PX // 2
            part = Part(y - half, y + half, x - half, x + half).within(image.shape)
            if part.pixels:
                self._last.append((part, image[part.top : part.bottom, part.left : part.right].copy()))

    def light(self, image: NDArray[Any]) -> tuple[Float, Float]:
        """Return two numbers for each patch.

        They are by how much the share of saturated pixels has grown since the reference, and the contrast as
        a share of that in the reference. A covered lens leaves some light. Many points still correlate then,
        with large errors.
        """
        if self._usual is None:
            self._level = saturation_level(image.dtype, float(self._reference.max()))
            self._usual = _shares(self._reference, self._at_rest, self._level)
        parts = self._parts(image.shape)
        with np.errstate(divide="ignore", invalid="ignore"):
            contrasts = _contrasts(image, parts) / self._usual_contrasts
        return _shares(image, parts, self._level) - self._usual, contrasts

    def _parts(self, shape: tuple[int, ...]) -> list[Part]:
        """Return the part of the frame that shows each patch."""
        parts = self._tracker.windows_of(self._numbers, self._starts)
        return [part.within(shape) for part in parts]


def saturation_level(kind: np.dtype[Any], greatest: float) -> int | None:
    """Return the grey level of a saturated pixel; None for floating-point numbers, which have none.

    Images of 10, 12 or 14 bit are stored with 16. The `greatest` grey level of the reference tells how many
    bits there are.
    """
    if kind.kind != "u":
        return None
    full = int(np.iinfo(kind).max)
    fewer = _FEWER_BITS if full > _EIGHT_BIT else ()
    return next((level for level in fewer if greatest <= level), full)


def _shares(image: NDArray[Any], windows: Sequence[Part], level: int | None) -> Float:
    """Return the share of saturated pixels in each window."""
    if level is None:
        return np.zeros(len(windows))
    shown = (image[part.top : part.bottom, part.left : part.right] for part in windows)
    return np.array([np.count_nonzero(each >= level) / max(1, each.size) for each in shown])


def _contrasts(image: NDArray[Any], windows: Sequence[Part]) -> Float:
    """Return the standard deviation of the grey levels in each window; NaN without pixels."""
    shown = (image[part.top : part.bottom : _SKIP_PX, part.left : part.right : _SKIP_PX] for part in windows)
    return np.array([each.std(dtype=np.float32) if each.size else np.nan for each in shown])
