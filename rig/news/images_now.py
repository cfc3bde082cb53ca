"""Light and focus of the newest image of each camera, for a person who watches a run."""

import math
import threading
from dataclasses import dataclass

from drivers.clock import Clock, SystemClock
from drivers.interfaces import Frame
from rig.engine.engine import Engine
from rig.engine.image_checks import Measures, measure

AGAIN_S = 1.0
"""Shortest real time in s between two measurements. An image of 4 megapixels takes some milliseconds."""


@dataclass(frozen=True)
class ImageNow:
    """Light and focus of an image, as `rig.engine.image_checks` measures them.

    Attributes
    ----------
    brightness : float
        Mean grey level, as a share of the highest one.
    saturated : float
        Share of the pixels at the highest grey level.
    sharpness : float
        Share of the sharpness of the reference image; NaN before the reference image and for a black image.
    """

    brightness: float
    saturated: float
    sharpness: float = math.nan


class ImagesNow:
    """Measures the newest images of a run, which the engine keeps. Any thread may call every method.

    `latest` has the newest measures by camera; reading it takes no time.
    """

    def __init__(self, engine: Engine, clock: Clock | None = None) -> None:
        self._engine = engine
        self._bits = {name: each.info.bits for name, each in engine.context.rig.cameras.items()}
        self._clock = clock or SystemClock()
        self._turn = threading.Lock()
        self._told_s = -math.inf
        self._before: dict[str, tuple[Frame, Measures]] = {}
        self._reference: dict[str, Measures] = {}
        self.latest: dict[str, ImageNow] = {}

    def now(self, *, at_once: bool = False) -> dict[str, ImageNow]:
        """Measure the newest images and return `latest`; not within `AGAIN_S`, except `at_once`."""
        with self._turn:
            if at_once or self._clock.now_s() - self._told_s >= AGAIN_S:
                self._measure()
                self._told_s = self._clock.now_s()
        return self.latest

    def keep_reference(self) -> None:
        """Compare the sharpness of later images with that of the newest images."""
        with self._turn:
            self._measure()
            self._reference = {name: measured for name, (_, measured) in self._before.items()}
            self._measure()

    def _measure(self) -> None:
        for name, frame in self._engine.newest_images.items():
            if name not in self._before or self._before[name][0] is not frame:
                self._before[name] = frame, measure(frame.image, self._bits[name])
        self.latest = {name: self._told(name, measured) for name, (_, measured) in self._before.items()}

    def _told(self, name: str, measured: Measures) -> ImageNow:
        first = self._reference.get(name)
        known = first is not None and first.sharpness > 0.0
        share = measured.sharpness / first.sharpness if known and first is not None else math.nan
        return ImageNow(measured.mean / ((1 << self._bits[name]) - 1), measured.saturated, share)
