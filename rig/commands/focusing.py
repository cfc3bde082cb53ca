"""Stream images of all cameras while a person sets up the rig, and measure focus, light, speckles and grid.

Each camera has a thread, which takes one image after the other and measures what takes milliseconds. One more
thread computes what takes longer, from the newest image of each camera in turn. Nothing moves.
"""

import math
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from dic.targets import Target
from drivers.clock import SystemClock
from drivers.errors import DeviceError
from drivers.interfaces import Camera, Frame
from rig.commands.check import Image
from rig.commands.focus_figures import SlowFigures, slow_figures
from rig.devices import Rig
from rig.engine.calls import CAMERA_MARGIN_S, PATIENCE_S
from rig.engine.image_checks import ImageChecks, Measures
from rig.news import wording
from rig.protocol.images import Images
from rig.threads import Bounded, DeviceThread

GRAB_S = 5.0
"""Longest time in s for an image."""
AGAIN_S = 1.0
"""After an error, the next image is asked for after this time in s."""
LEAVING_S = 15.0
"""Longest time in s for which the end waits for all threads together."""
_RATE_FRAMES = 10
_POLL_S = 0.05


@dataclass(frozen=True)
class ImageFigures:
    """What is measured of each image.

    Attributes
    ----------
    sharpness, best : float
        Mean difference of near pixels over the mean grey level, as `rig.engine.image_checks` measures it, and
        the largest one so far; NaN for a black or very small image.
    darkest, brightest, full : int
        Grey levels, and the highest one that the camera can deliver.
    mean, saturated : float
        Mean grey level, and the share of pixels at the highest one.
    rate_hz : float
        Images per second, NaN at the beginning.
    frozen : bool
        True if the picture has exactly the pixels of the one before.
    """

    sharpness: float
    best: float
    darkest: int
    brightest: int
    full: int
    mean: float
    saturated: float
    rate_hz: float
    frozen: bool


class CameraFocus(DeviceThread):
    """Takes images with one camera and measures them, on a thread of its own or image by image.

    Parameters
    ----------
    name : str
    camera : Camera
    rig : Rig
    deadline_s : float, optional
        Longest real time in s for an image. Default: `GRAB_S` and what a camera's driver gets in addition.

    Attributes
    ----------
    newest : Frame or None
    taken_s : float
        When it was received, on the computer's clock.
    figures : ImageFigures or None
        Those of the newest image.
    slow : SlowFigures or None
        Those of an older image.
    trouble : str
        Why there is no image now; empty if there is one.
    lost : bool
        True if a call of the driver hangs, so that no more images are taken.
    """

    def __init__(self, name: str, camera: Camera, rig: Rig, deadline_s: float | None = None) -> None:
        super().__init__(f"focus of {name}")
        self.camera_name, self._camera, self._rig = name, camera, rig
        self._checks = ImageChecks(camera.info, Images())
        self._clock, self._ended = SystemClock(), threading.Event()
        self._times_s: deque[float] = deque(maxlen=_RATE_FRAMES)
        self.newest: Frame | None = None
        self.taken_s = math.nan
        self.figures: ImageFigures | None = None
        self.slow: SlowFigures | None = None
        self.trouble, self.lost = "", False
        self._best_is_known = False
        # a simulated camera computes while its clock stands still
        patience_s = 0.0 if isinstance(rig.clock, SystemClock) else PATIENCE_S
        self._deadline_s = deadline_s or GRAB_S + CAMERA_MARGIN_S + patience_s

    def run(self) -> None:
        """Take images until `end` is called."""
        while not (self._ended.is_set() or self.lost):
            self.take()
            if self.trouble:
                self._ended.wait(AGAIN_S)

    def end(self) -> None:
        """Take no more images."""
        self._ended.set()

    def forget_best(self) -> None:
        """Compare the sharpness with that of later images only."""
        self._best_is_known = False

    def take(self) -> None:
        """Take and measure one image. An error of the camera becomes `trouble`."""
        device = f"cameras.{self.camera_name}"
        call = Bounded(device, "grab", lambda: self._camera.grab(GRAB_S))
        try:
            frame = call.result(self._deadline_s, "check the camera and its cable")
            self._checks.require_format(frame, device, "focus")
        except DeviceError as error:
            self.trouble = str(error)
            self.lost = call.hangs
            if call.hangs:
                self._rig.lost[device] = f"grab, which has not returned for {self._deadline_s:g} s"
            return
        self.trouble = ""
        self._measure(frame)

    def _measure(self, frame: Frame) -> None:
        measured = self._checks.measure(frame)
        frozen = self._checks.is_frozen(measured)
        self._checks.accept(frame, measured, reference=False)
        self.newest, self.taken_s = frame, self._clock.now_s()
        self._times_s.append(self.taken_s)
        self.figures = self._figures(frame.image, measured, frozen=frozen)

    def _figures(self, image: Image, measured: Measures, *, frozen: bool) -> ImageFigures:
        known = self._best_is_known and self.figures is not None
        best = self.figures.best if known and self.figures is not None else math.nan
        self._best_is_known = True
        times_s = self._times_s
        span_s = times_s[-1] - times_s[0]
        return ImageFigures(
            measured.sharpness,
            measured.sharpness if math.isnan(best) else max(best, measured.sharpness),
            int(image.min()),
            int(image.max()),
            (1 << self._camera.info.bits) - 1,
            measured.mean,
            measured.saturated,
            (len(times_s) - 1) / span_s if span_s > 0.0 else math.nan,
            frozen,
        )

    def compute(self, target: Target | None) -> bool:
        """Compute the slow figures of the newest image. Return False if it is not newer than the last one."""
        frame, taken_s = self.newest, self.taken_s
        if frame is None or (self.slow is not None and taken_s == self.slow.taken_s):
            return False
        self.slow = slow_figures(frame.image, self._camera.info.bits, target, taken_s)
        return True

    def table(self) -> dict[str, Any]:
        """Return all figures as a table for JSON."""
        figures = None if self.figures is None else vars(self.figures)
        return {
            "figures": None
            if figures is None
            else {
                name: wording.number(value) if isinstance(value, float) else value
                for name, value in figures.items()
            },
            "slow": None if self.slow is None else self.slow.as_dict(),
            "trouble": self.trouble or None,
        }


class Focus:
    """The cameras of a rig while it is set up.

    Parameters
    ----------
    rig : Rig
    target : Target or None
        The grid that is looked for.
    """

    def __init__(self, rig: Rig, target: Target | None) -> None:
        self.cameras = [CameraFocus(name, camera, rig) for name, camera in rig.cameras.items()]
        self._target, self._ended, self.failure = target, threading.Event(), ""
        self._computer = threading.Thread(target=self._compute, name="figures of images", daemon=True)

    def once(self) -> None:
        """Take one image with each camera, and compute all of its figures."""
        for each in self.cameras:
            each.take()
            each.compute(self._target)

    def begin(self) -> None:
        """Stream until `end` is called."""
        for each in self.cameras:
            each.start()
        self._computer.start()

    def end(self) -> None:
        """End all threads, and wait for those that do not hang."""
        self._ended.set()
        for each in self.cameras:
            each.end()
        threads: list[threading.Thread] = [each for each in self.cameras if not each.lost]
        until_s = SystemClock().now_s() + LEAVING_S
        for thread in [*threads, self._computer]:
            thread.join(max(0.0, until_s - SystemClock().now_s()))

    @property
    def over(self) -> bool:
        """True if no camera delivers images any more, or the computation has failed."""
        return all(each.lost for each in self.cameras) or bool(self.failure)

    def keep(self, keep: Callable[[str, Image], None], ending: str = "") -> list[str]:
        """Keep the newest image of each camera, and return their names."""
        kept = [(each.camera_name + ending, each.newest) for each in self.cameras]
        for name, frame in kept:
            if frame is not None:
                keep(name, frame.image)
        return [name for name, frame in kept if frame is not None]

    def _compute(self) -> None:
        try:
            while not self._ended.is_set():
                computed = [each.compute(self._target) for each in self.cameras]
                if not any(computed):
                    self._ended.wait(_POLL_S)
        except Exception as error:
            self.failure = f"{type(error).__name__}: {error}"
