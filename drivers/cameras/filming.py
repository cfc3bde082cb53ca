"""Base class of cameras that film continuously. A caller gets one new frame per call, or all frames."""

import math
import threading
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Generic, Protocol, TypeVar

from drivers.clock import Clock, VirtualClock
from drivers.errors import DeviceFault, DeviceTimeout, LinkLost
from drivers.interfaces import CameraInfo, Frame, OpenContext, Setting
from drivers.streams.stream import CAPACITY, FrameStream

SILENCE_S = 1.0
SILENCE_FRAMES = 10
LOST_FRAMES = 3
"""A camera counts as lost if it sends no frame for this number of frame times."""
READING_S = 2.0
"""Longest time, in seconds, for which `read_settings` waits for the camera."""
OPENING_S = 20.0
"""Longest time, in seconds, for reopening a camera when a stream is opened."""


class FilmingSession(Protocol):
    """Interface of an opened camera that films until it is closed."""

    seen: int  # number of frames received since opening, including old frames

    @property
    def interval_s(self) -> float:
        """Time between two frames, in seconds; infinite if a trigger begins each frame."""

    @property
    def shortest_s(self) -> float:
        """Shortest time between two frames, in seconds, also if a trigger begins each frame."""

    def next_frame(self, timeout_s: float, after_s: float) -> Frame | None:
        """Return the next frame whose exposure began after `after_s`. Return None after `timeout_s`."""

    def verify(self) -> None:
        """Read the settings back. Raise `DeviceFault` if one has changed, `LinkLost` if no answer comes."""

    def read_settings(self) -> dict[str, Setting]:
        """Read all settings back from the camera, and raise the same errors as `verify`."""

    def close(self) -> None:
        """Stop filming and release all resources. A repeated call has no effect."""


S = TypeVar("S", bound=FilmingSession)


class FilmingCamera(ABC, Generic[S]):
    """A `Camera` that films all the time. `grab` discards the frames that were exposed before its call."""

    info: CameraInfo
    silent_is_lost = False
    """True for drivers that close and reopen a camera that sends no frames."""

    def __init__(self, name: str, clock: Clock) -> None:
        self._name = name
        self._clock = clock
        self._lock = threading.Lock()
        self._stream: FrameStream | None = None
        self._closed = False
        self._session: S | None = None
        self._silent_s = 0.0

    def grab(self, timeout_s: float) -> Frame:
        """Return a frame whose exposure began after this call. In a damaged frame, `flags` is not 0.

        Raise `DeviceTimeout` if no frame exposed after the call arrives within `timeout_s` seconds,
        `LinkLost` if the camera was unplugged or does not answer any more, and `DeviceFault` if the camera
        reports errors, a setting has changed, or a stream is open.
        """
        asked_s = self._clock.now_s()
        with to_itself(self._lock, self._name, "grab", timeout_s):
            session = self._ready("grab", asked_s + timeout_s)
            before, begun_s = session.seen, self._clock.now_s()
            with self._giving_up_lost():
                frame = session.next_frame(asked_s + timeout_s - self._clock.now_s(), after_s=asked_s)
                if frame is not None:
                    self._silent_s = 0.0
                    session.verify()
                    return frame
            older = session.seen - before
            self._silent_s = 0.0 if older else self._silent_s + self._clock.now_s() - begun_s
            if self.silent_is_lost and self._silent_s > LOST_FRAMES * session.interval_s:
                self._give_up()
        checks = "trigger line and cable" if math.isinf(session.interval_s) else "cable and power"
        raise DeviceTimeout(
            self._name,
            "grab",
            f"a frame exposed after the call, within {timeout_s:g} s",
            f"none but {older} older" if older else "none",
            "allow more time" if older else f"check {checks}, or allow more time",
        )

    def stream(self, capacity: int = CAPACITY) -> FrameStream:
        """Return a stream of all frames from now on. `grab` is refused until the stream is closed.

        `capacity` is the largest number of frames in the queue. Raise `DeviceError` if the camera fails, or a
        stream is already open. See `grab`.
        """
        with to_itself(self._lock, self._name, "stream", OPENING_S):
            session = self._ready("stream", self._clock.now_s() + OPENING_S)
            begun_s = self._clock.now_s()
            with self._giving_up_lost():
                session.verify()

            def source(timeout_s: float) -> Frame | None:
                with self._giving_up_lost():
                    return session.next_frame(timeout_s, after_s=begun_s)

            self._stream = FrameStream(
                self._name,
                source,
                self._clock,
                interval_s=session.interval_s,
                shortest_s=session.shortest_s,
                silence_s=max(SILENCE_S, SILENCE_FRAMES * session.interval_s),
                capacity=capacity,
                on_close=self._stream_closed,
            )
            return self._stream

    def read_settings(self) -> dict[str, Setting]:
        """Read all settings back from the camera.

        Raise `DeviceError` if the camera does not answer, is used by another call, or a stream is open. See
        `grab`.
        """
        with to_itself(self._lock, self._name, "read settings", READING_S):
            session = self._ready("read settings", self._clock.now_s() + READING_S)
            with self._giving_up_lost():
                return session.read_settings()

    def close(self) -> None:
        """Release the camera. A repeated call has no effect."""
        # set `_closed` before waiting for the lock, because threads that call `grab` in turns might never
        # release it
        self._closed = True
        with self._lock:
            stream = self._stream
        if stream is not None:
            stream.close()
        with self._lock:
            self._give_up()

    @abstractmethod
    def _open_again(self, step: str, deadline_s: float) -> S:
        """Reopen the camera after a lost connection. Opening must end before `deadline_s`."""

    def _give_up(self) -> None:
        session, self._session = self._session, None
        if session is not None:
            session.close()

    def _ready(self, step: str, deadline_s: float) -> S:
        if self._closed:
            raise DeviceFault(self._name, step, "an open camera", "a closed one", "open it again")
        if self._stream is not None:
            raise DeviceFault(
                self._name,
                step,
                "no open stream",
                "a stream that takes every frame",
                "take the frame from the stream, or close it",
            )
        if self._session is None:
            self._session = self._open_again(step, deadline_s)
            self._silent_s = 0.0
        return self._session

    def _stream_closed(self) -> None:
        self._stream = None

    @contextmanager
    def _giving_up_lost(self) -> Iterator[None]:
        try:
            yield
        except LinkLost:
            self._give_up()
            raise


@contextmanager
def to_itself(lock: threading.Lock, device: str, step: str, timeout_s: float) -> Iterator[None]:
    """Reserve a camera for one call. Raise `DeviceTimeout` if another call uses it longer than
    `timeout_s`."""
    if not lock.acquire(timeout=min(max(0.0, timeout_s), threading.TIMEOUT_MAX)):
        raise DeviceTimeout(
            device,
            step,
            "a camera that no other call uses",
            f"one in use for {timeout_s:g} s",
            "call it from one thread, or take its frames from a stream",
        )
    try:
        yield
    finally:
        lock.release()


def refuse_simulated_time(device: str, context: OpenContext) -> None:
    """Raise `DeviceFault` if the clock of the rig is simulated, because a real camera needs real time."""
    if isinstance(context.clock, VirtualClock):
        raise DeviceFault(
            device,
            "open camera",
            "a rig in real time",
            "simulated time, which a real camera cannot follow",
            "use driver 'simulated-camera' in a simulated rig",
        )
