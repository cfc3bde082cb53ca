"""The images of one camera for given times: from its stream, or taken when they are due."""

import math
from collections import deque
from contextlib import suppress
from typing import Any, Protocol

from drivers.clock import Clock
from drivers.errors import DeviceTimeout
from drivers.interfaces import Frame
from rig.engine.calls import CAMERA_MARGIN_S, Call, Deadline
from rig.engine.devices import CalledCamera

_SLICE_S = 0.25
"""Longest time in s of one call that takes frames from a stream."""
_KEPT = 8
"""Frames of a stream that are kept, because an event of a channel is seen some time after it."""
_STREAM_FRAMES = 64
_REMEDY = "check the camera and its cable, or raise images.timeout_s"


class Feed(Protocol):
    """Takes the images of one camera for the times that are asked for, in their order.

    Attributes
    ----------
    most_open : int
        Number of images that may be asked for and not delivered yet.
    """

    most_open: int

    def ask(self, due_s: float) -> None:
        """Ask for the image whose exposure is nearest to a time, which is not in the future."""

    def take(self) -> Frame | None:
        """Return the image for the oldest time that was asked for, None while there is none.

        Raise `DeviceError` if the camera fails. The engine calls this method often.
        """

    def close(self) -> None:
        """End the stream of the camera."""


def feed_of(camera: CalledCamera, clock: Clock, timeout_s: float) -> Feed:
    """Return the feed of a camera: its stream if its driver has one. Raise `DeviceError` if it fails."""
    if callable(getattr(camera.camera, "stream", None)):
        return StreamFeed(camera, clock, timeout_s)
    return GrabFeed(camera, timeout_s)


class GrabFeed:
    """A camera without a stream, which begins each image when it is asked for it."""

    most_open = 1

    def __init__(self, camera: CalledCamera, timeout_s: float) -> None:
        self._camera, self._timeout_s = camera, timeout_s
        self._call: Call[Frame] | None = None

    def ask(self, due_s: float) -> None:
        """Begin an image."""
        assert self._call is None
        camera, timeout_s = self._camera.camera, self._timeout_s
        self._call = self._camera.calls.begin(
            f"cameras.{self._camera.name}",
            "grab",
            lambda: camera.grab(timeout_s),
            Deadline(timeout_s + CAMERA_MARGIN_S, _REMEDY),
        )

    def take(self) -> Frame | None:
        """Return the image if it has arrived."""
        call = self._call
        if call is None or not is_over(call):
            return None
        self._call = None
        return self._camera.calls.finish(call)

    def close(self) -> None:
        """End: nothing runs without an image that was asked for."""


class StreamFeed:
    """A camera that delivers all its frames, from which the nearest one is taken for each time."""

    most_open = _KEPT

    def __init__(self, camera: CalledCamera, clock: Clock, timeout_s: float) -> None:
        self._name, self._calls = f"cameras.{camera.name}", camera.calls
        self._clock, self._timeout_s = clock, timeout_s
        driver: Any = camera.camera
        opening = Deadline(timeout_s + CAMERA_MARGIN_S, _REMEDY)
        self._stream = self._calls.do(self._name, "stream", lambda: driver.stream(_STREAM_FRAMES), opening)
        self._dues_s: deque[float] = deque()
        self._frames: deque[Frame] = deque(maxlen=_KEPT)
        self._heard_s = clock.now_s()
        self._used = -math.inf
        self._call: Call[None] | None = None

    def ask(self, due_s: float) -> None:
        """Ask for the frame nearest to a time."""
        self._dues_s.append(due_s)

    def take(self) -> Frame | None:
        """Return the frame for the oldest time if the stream has passed it, and go on taking frames."""
        if self._call is not None and is_over(self._call):
            call, self._call = self._call, None
            self._calls.finish(call)
        if self._call is None:
            deadline = Deadline(self._timeout_s + _SLICE_S + CAMERA_MARGIN_S, _REMEDY)
            self._call = self._calls.begin(self._name, "take frames", self._drain, deadline)
        return self._nearest()

    def close(self) -> None:
        """End the stream."""
        with suppress(DeviceTimeout):
            self._calls.do(self._name, "close stream", self._stream.close, Deadline(self._timeout_s, _REMEDY))

    def _drain(self) -> None:
        """Take frames for a short time, or until one has passed the oldest time. On the camera's thread."""
        end_s = self._clock.now_s() + _SLICE_S
        while self._clock.now_s() < end_s:
            try:
                frame = self._stream.next(_SLICE_S)
            except DeviceTimeout:
                if self._clock.now_s() - self._heard_s > self._timeout_s:
                    raise
                return
            self._heard_s = self._clock.now_s()
            self._frames.append(frame)
            if self._dues_s and frame.middle[0] >= self._dues_s[0]:
                return

    def _nearest(self) -> Frame | None:
        frames = [frame for frame in tuple(self._frames) if frame.sequence > self._used]
        if not self._dues_s or not frames or frames[-1].middle[0] < self._dues_s[0]:
            return None
        due_s = self._dues_s.popleft()
        frame = min(frames, key=lambda each: abs(each.middle[0] - due_s))
        self._used = frame.sequence
        return frame


def is_over(call: Call[Any]) -> bool:
    """Return True if a call has ended, or has exceeded its deadline, so that `finish` returns at once."""
    return call.done or call.left_s <= 0.0 or call.real_left_s <= 0.0
