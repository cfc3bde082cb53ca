"""The images of one camera for given times: from its stream, or taken when they are due."""

import math
from collections import deque
from collections.abc import Callable
from enum import Enum
from threading import Lock
from typing import Any, TypeAlias

from drivers.clock import Clock
from drivers.errors import DeviceTimeout
from drivers.interfaces import Frame
from rig.devices import OPENING_S
from rig.engine.calls import CAMERA_MARGIN_S, Call, Calls, Deadline
from rig.engine.devices import CalledCamera
from rig.engine.trigger_faults import RegularTriggers

_SLICE_S = 0.25
"""Longest time in s of one call that takes frames from a stream."""
_KEPT_LEAST, _KEPT_MOST, _KEPT_BYTES = 8, 64, 64 << 20
"""Frames of a stream that are kept, because an event of a channel is seen some time after it."""
_STREAM_FRAMES = 64
_OPEN_MOST = 8
_REMEDY = "check the camera and its cable, or raise images.timeout_s"


class Missed(Enum):
    """Says that a camera has no image of its own for a time, because it takes them too slowly."""

    IMAGE = "no image"


Taken: TypeAlias = Frame | Missed


Tap: TypeAlias = Callable[[str, Frame], None]
"""Type of a function that is called with a camera's name and each of its frames, also those that are not
wanted as images, on the camera's thread."""


def feed_of(
    camera: CalledCamera, clock: Clock, timeout_s: float, tolerance_s: float, tap: Tap
) -> "GrabFeed | StreamFeed":
    """Return the feed of a camera: its stream if its driver has one. Raise `DeviceError` if it fails.

    `timeout_s` is the longest time in s without an image. An image that is more than `tolerance_s` away from
    its time counts as missed if the image before was nearer.
    """
    if callable(getattr(camera.camera, "stream", None)):
        return StreamFeed(camera, clock, timeout_s, tolerance_s, tap)
    return GrabFeed(camera, timeout_s, tap)


class GrabFeed:
    """A camera without a stream, which begins each image when it is asked for it.

    Attributes
    ----------
    most_open : int
        Number of images that may be asked for and not delivered yet.
    is_stream : bool
        True if the camera delivers frames that nobody asked for.
    is_ready : bool
        False until the stream of the camera has delivered its first frame.
    lost : int
        Number of frames of the stream that are lost so far.
    """

    most_open = 1
    is_stream = False
    is_ready = True
    lost = 0

    def __init__(self, camera: CalledCamera, timeout_s: float, tap: Tap) -> None:
        self._camera, self._timeout_s, self._tap = camera, timeout_s, tap
        self._call: Call[Frame] | None = None

    def ask(self, due_s: float) -> None:
        """Begin an image."""
        assert self._call is None
        timeout_s = self._timeout_s
        self._call = self._camera.calls.begin(
            f"cameras.{self._camera.name}",
            "grab",
            self._grab,
            Deadline(timeout_s + CAMERA_MARGIN_S, _REMEDY),
        )

    def _grab(self) -> Frame:
        """Take an image. On the camera's thread."""
        frame = self._camera.camera.grab(self._timeout_s)
        self._tap(self._camera.name, frame)
        return frame

    def take(self) -> Taken | None:
        """Return the image if it has arrived."""
        call = self._call
        if call is None or not call.is_over:
            return None
        self._call = None
        return self._camera.calls.finish(call)

    def begin_close(self) -> Call[None] | None:
        """End: nothing runs without an image that was asked for."""
        return None

    def losses(self) -> str:
        """Return nothing: no frame comes that was not asked for."""
        return ""


class StreamFeed:
    """A camera that delivers all its frames, from which the nearest one is taken for each time."""

    most_open = _OPEN_MOST
    is_stream = True
    pairs_within_s = math.inf
    """A frame that is farther than this from its time is no image of it, also if it is the nearest one."""

    def __init__(
        self, camera: CalledCamera, clock: Clock, timeout_s: float, tolerance_s: float, tap: Tap
    ) -> None:
        self._camera_name, self._tap = camera.name, tap
        self._name, self._calls = f"cameras.{camera.name}", camera.calls
        self._clock, self._timeout_s, self._tolerance_s = clock, timeout_s, tolerance_s
        driver: Any = camera.camera
        # Watch the call, because a camera that must be opened again takes many seconds.
        opening = _begin(self._calls, self._name, "stream", lambda: driver.stream(_STREAM_FRAMES), OPENING_S)
        self._stream = self._calls.finish(opening, watched=True)
        # Streams of other packages may not tell the times between their frames.
        self.is_triggered = getattr(self._stream, "interval_s", 0.0) == math.inf
        self.shortest_s: float = getattr(self._stream, "shortest_s", math.nan)
        self._gives_all = False
        self._lost_before = 0
        self._dues_s: deque[float] = deque()
        self._frames: deque[Frame] = deque()
        # The engine looks for the nearest frame while the camera's thread appends the newest one.
        self._lock = Lock()
        self._heard_s = clock.now_s()
        self._empty_s = -math.inf
        self._asked_s: deque[float] = deque()
        self._used_s = -math.inf
        self._triggers = RegularTriggers(timeout_s)
        self.unanswered = 0
        """Number of images that a triggered camera was asked for, but no frame came."""
        self._call: Call[None] | None = None
        self._lost = ""
        self._lost_after = 0

    @property
    def is_ready(self) -> bool:
        """True if there is a frame, or if frames come only when something triggers them."""
        return self.is_triggered or bool(self._frames)

    @property
    def lost(self) -> int:
        """Number of frames that are lost so far."""
        return sum(loss.count for loss in self._stream.report().losses)

    def ask(self, due_s: float) -> None:
        """Ask for the frame nearest to a time."""
        with self._lock:
            self._dues_s.append(due_s)
            self._asked_s.append(self._clock.now_s())

    def take(self) -> Taken | None:
        """Return the frame for the oldest time if the stream has passed it, and go on taking frames."""
        self._go_on()
        return self._nearest()

    def give_all_from(self, begun_s: float) -> None:
        """From now on, give all frames exposed from a time on with `take_next`, and lose none."""
        with self._lock:
            self._used_s = math.nextafter(begun_s, -math.inf)
            self._gives_all = True
        self._lost_before = sum(self._lost_by_kind().values())

    def take_next(self) -> Frame | None:
        """Return the oldest frame that was not given yet, None while there is none."""
        self._go_on()
        with self._lock:
            while self._frames:
                frame = self._frames.popleft()
                if frame.middle[0] > self._used_s:
                    self._used_s = frame.middle[0]
                    self._triggers.see(self._used_s)
                    return frame
        return None

    def untriggered(self) -> int:
        """Return how many frames of regular triggers are missing now that were not told before."""
        return self._triggers.missing(self._empty_s) if self.is_triggered else 0

    def _go_on(self) -> None:
        """Go on taking frames from the stream. Raise the error of the call that took them."""
        if self._call is not None and self._call.is_over:
            call, self._call = self._call, None
            self._calls.finish(call)
        if self._call is None:
            within_s = self._timeout_s + _SLICE_S + CAMERA_MARGIN_S
            self._call = _begin(self._calls, self._name, "take frames", self._drain, within_s)

    def begin_close(self) -> Call[None] | None:
        """Begin to end the stream, after the call that takes frames has ended."""
        return _begin(self._calls, self._name, "close stream", self._end, self._timeout_s + CAMERA_MARGIN_S)

    def losses(self) -> str:
        """Return how many frames of the closed stream are missing, and why."""
        return self._lost

    @property
    def lost_since(self) -> int:
        """Number of frames of the closed stream that are missing since `give_all_from`."""
        return self._lost_after

    def _lost_by_kind(self) -> dict[str, int]:
        counts: dict[str, int] = {}
        for loss in self._stream.report().losses:
            counts[loss.kind.value] = counts.get(loss.kind.value, 0) + loss.count
        return counts

    def _end(self) -> None:
        """Close the stream, and note its losses. On the camera's thread."""
        try:
            counts = self._lost_by_kind()
            self._lost_after = max(0, sum(counts.values()) - self._lost_before)
            why = ", ".join(f"{count} ({kind})" for kind, count in counts.items() if count)
            self._lost = f"{self._name}: frames of its stream are lost: {why}" if why else ""
        finally:
            self._stream.close()

    def _drain(self) -> None:
        """Take frames for a short time, or until one has passed the oldest time. On the camera's thread."""
        end_s = self._clock.now_s() + _SLICE_S
        while self._clock.now_s() < end_s:
            if self._gives_all and len(self._frames) >= _KEPT_LEAST:
                return  # the others wait in the queue of the stream, which counts those for which it is full
            try:
                frame = self._stream.next(_SLICE_S)
            except DeviceTimeout:
                self._empty_s = self._clock.now_s()
                if self._clock.now_s() - self._heard_s > self._timeout_s and not self.is_triggered:
                    raise
                return
            self._heard_s = self._clock.now_s()
            self._tap(self._camera_name, frame)
            kept = min(_KEPT_MOST, max(_KEPT_LEAST, _KEPT_BYTES // frame.image.nbytes))
            with self._lock:
                self._frames.append(frame)
                while len(self._frames) > kept and not self._gives_all:
                    self._frames.popleft()
                if self._dues_s and frame.middle[0] >= self._dues_s[0]:
                    return

    def _nearest(self) -> Taken | None:
        with self._lock:
            if not self._dues_s:
                return None
            due_s = self._dues_s[0]
            unused = [frame for frame in self._frames if frame.middle[0] > self._used_s]
            frame = min(unused, key=lambda each: abs(each.middle[0] - due_s), default=None)
            off_s = math.inf if frame is None else abs(frame.middle[0] - due_s)
            is_passed = bool(unused) and unused[-1].middle[0] >= due_s
            # of a triggered camera the next frame may be far away, and cannot be nearer
            if not (is_passed or (self.is_triggered and off_s <= self.shortest_s / 2)):
                return self._waited_for()
            self._dues_s.popleft()
            self._asked_s.popleft()
            slow = off_s > self._tolerance_s and abs(self._used_s - due_s) < off_s
            if frame is None or slow or off_s > self.pairs_within_s:
                # A frame belongs to one time only. If this camera is slower than the times, taking the next
                # frame would shift all later images, and not only leave one out.
                return Missed.IMAGE
            self._used_s = frame.middle[0]
            return frame

    def _waited_for(self) -> Taken | None:
        """Return None as long as the oldest time may be waited for; afterwards, a triggered camera missed it.

        Raise `DeviceTimeout` if frames of another camera come, but none for the time.
        """
        if self._clock.now_s() - self._asked_s[0] <= self._timeout_s + _SLICE_S + CAMERA_MARGIN_S:
            return None
        if self.is_triggered:
            self._dues_s.popleft()
            self._asked_s.popleft()
            self.unanswered += 1
            return Missed.IMAGE
        raise DeviceTimeout(
            self._name,
            "stream",
            f"a frame exposed after {self._dues_s[0]:.3f} s within {self._timeout_s:g} s",
            "earlier ones only",
            "check the camera's driver, whose times do not advance with the rig's clock",
        )


def _begin(calls: Calls, device: str, action: str, function: Callable[[], Any], within_s: float) -> Call[Any]:
    return calls.begin(device, action, function, Deadline(within_s, _REMEDY))
