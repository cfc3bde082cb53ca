"""The frames that a camera takes while a channel is recorded: their times, and the light that they show."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np

from drivers.errors import DeviceTimeout
from drivers.interfaces import Camera, Frame
from rig.samples import Floats

_FRAME_S = 5.0
_STREAM_FRAMES = 64
_BLOCKS = 16
_CHOSEN_SHARE = 0.5
_EVERY_PX = 4


@dataclass
class Film:
    """The middles and lengths of all exposures of a camera, in s. A length is 0 if it is unknown."""

    camera: Camera
    bits: int
    middles_s: list[float] = field(default_factory=list)
    lengths_s: list[float] = field(default_factory=list)

    def take(self, now_s: Callable[[], float], until_s: float) -> None:
        """Film until a time: all frames of the camera's stream, or images one after the other."""
        camera: Any = self.camera
        stream = camera.stream(_STREAM_FRAMES) if callable(getattr(camera, "stream", None)) else None
        is_triggered = getattr(stream, "interval_s", 0.0) == math.inf
        try:
            while (left_s := until_s - now_s()) > 0.0:
                try:
                    wait_s = min(_FRAME_S, left_s) if is_triggered else _FRAME_S
                    self.add(camera.grab(_FRAME_S) if stream is None else stream.next(wait_s))
                except DeviceTimeout:
                    if not is_triggered:
                        raise
        finally:
            if stream is not None:
                stream.close()

    def add(self, frame: Frame) -> None:
        """Keep what is needed of a frame."""
        self.middles_s.append(frame.middle[0])
        length_us = frame.exposure_us
        self.lengths_s.append(0.0 if np.isnan(length_us) else 1e-6 * length_us)

    @property
    def times(self) -> tuple[Floats, Floats]:
        """Middles and lengths of the exposures."""
        return np.array(self.middles_s), np.array(self.lengths_s)


@dataclass
class LightFilm(Film):
    """A film that also has the brightness of all images, in blocks, and their numbers of full pixels."""

    blocks: list[Any] = field(default_factory=list)
    full: list[int] = field(default_factory=list)

    def add(self, frame: Frame) -> None:
        """Keep the times and the brightness of a frame."""
        super().add(frame)
        means = cv2.resize(frame.image, (_BLOCKS, _BLOCKS), interpolation=cv2.INTER_AREA)
        self.blocks.append(means.astype(np.float32).ravel())
        some = frame.image[::_EVERY_PX, ::_EVERY_PX]
        self.full.append(int(np.count_nonzero(some >= (1 << self.bits) - 1)))

    def brightness(self) -> Floats:
        """Return the mean brightness of the region whose brightness changes most, for each image."""
        blocks = np.array(self.blocks)
        low, high = np.percentile(blocks, (2.0, 98.0), axis=0)
        change = high - low
        chosen = blocks[:, change >= _CHOSEN_SHARE * change.max()]
        return np.asarray(chosen.mean(axis=1), np.float64)
