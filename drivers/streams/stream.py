"""Deliver frames at the full rate of the camera, and record every missing frame."""

import threading
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import Protocol, Self

from drivers.clock import Clock, Event, GivenUp
from drivers.errors import DeviceFault, DeviceTimeout
from drivers.interfaces import Camera, Frame
from drivers.streams.losses import Loss, LossAccount, LossKind

CAPACITY = 64
SLICE_S = 0.1
"""Longest wait for a frame, in seconds, before the thread of the stream checks whether it must end."""


@dataclass(frozen=True)
class StreamReport:
    """Numbers of delivered and missing frames of a stream."""

    taken: int  # number of undamaged frames that were queued for the program
    losses: tuple[Loss, ...]  # the missing frames, in the order of detection

    @property
    def lost(self) -> int:
        """Total number of missing frames."""
        return sum(loss.count for loss in self.losses)


class FrameStream:
    """A thread that moves frames from a camera into a queue. Use the stream as a context manager.

    Frames with error flags are not delivered. When the queue is full, the newest frame is dropped. `report`
    lists every dropped, damaged or missing frame.

    On a simulated clock the thread is an `Activity`: simulated time stands still while the camera exposes and
    reads out, and a waiting reader continues at its turn, so that a run gives the same frames again.

    Parameters
    ----------
    device : str
        Name of the camera, used in error messages.
    source : callable
        ``source(timeout_s)`` returns the next frame, or None after the timeout. A failure raises
        `DeviceError`.
    clock : Clock
    interval_s : float
        Time between two frames, in seconds; infinite for frames that are triggered.
    shortest_s : float, optional
        Shortest time between two frames, in seconds. The default is `interval_s`.
    silence_s : float
        Time without a frame, in seconds, after which the stream ends with an error.
    capacity : int
        Largest number of frames in the queue.
    on_close : callable
        Function that is called once, after the thread has ended.

    Attributes
    ----------
    interval_s, shortest_s : float

    Raises
    ------
    DeviceFault
        If the capacity is less than one frame.
    """

    def __init__(
        self,
        device: str,
        source: Callable[[float], Frame | None],
        clock: Clock,
        *,
        interval_s: float,
        shortest_s: float | None = None,
        silence_s: float,
        capacity: int = CAPACITY,
        on_close: Callable[[], None],
    ) -> None:
        if capacity < 1:
            raise DeviceFault(
                device,
                "stream",
                "a queue with room for a frame",
                f"one for {capacity}",
                "choose a capacity of 1 or more",
            )
        self.interval_s = interval_s
        self.shortest_s = interval_s if shortest_s is None else shortest_s
        self._device = device
        self._source = source
        self._clock = clock
        self._silence_s = silence_s
        self._capacity = capacity
        self._on_close = on_close
        self._queue: deque[Frame] = deque()
        self._lock = threading.Lock()
        self._news = Event()
        self._ending = threading.Event()
        self._error: Exception | None = None
        self._taken = 0
        self._losses = LossAccount(interval_s)
        self._activity = clock.activity()
        self._thread = threading.Thread(target=self._fill, name=f"stream {device}", daemon=True)
        self._thread.start()

    def next(self, timeout_s: float) -> Frame:
        """Return the oldest frame in the queue.

        Raise `DeviceTimeout` if no frame arrives within `timeout_s` seconds, and `DeviceError` if an error
        ended the stream. The error is raised after all queued frames were taken.
        """
        deadline_s = self._clock.now_s() + timeout_s
        while True:
            with self._lock:
                if self._queue:
                    return self._queue.popleft()
                if self._error is not None:
                    raise self._error
                closed = self._ending.is_set()
                # Clear the flag within the lock, so that a frame that comes now sets it again.
                self._news.clear()
            left_s = deadline_s - self._clock.now_s()
            if closed or not left_s > 0:  # also True for NaN
                break
            self._clock.wait(self._news, left_s)
        got = "none, since the stream was closed" if closed else "none"
        raise self._timeout(f"a frame within {timeout_s:g} s", got)

    def report(self) -> StreamReport:
        """Return the present numbers of delivered and missing frames."""
        with self._lock:
            return StreamReport(self._taken, self._losses.losses())

    def close(self) -> None:
        """End the thread of the stream. A repeated call has no effect.

        Frames in the queue can still be taken.
        """
        self._ending.set()
        # On a simulated clock, the thread would otherwise wait for its turn until the caller sleeps.
        self._activity.end()
        self._thread.join()
        with self._lock:
            on_close, self._on_close = self._on_close, _nothing
        self._news.set()
        on_close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __iter__(self) -> Iterator[Frame]:
        """Yield frames until the stream is closed. Raise the camera's error if an error ended the stream."""
        while True:
            try:
                yield self.next(self._silence_s)
            except DeviceTimeout:
                if self._ending.is_set():
                    return
                raise

    def _fill(self) -> None:
        with suppress(GivenUp), self._activity:  # `close` ends the activity
            try:
                self._take_frames()
            except Exception as error:  # the thread that reads the queue will raise this exception
                with self._lock:
                    self._error = error
                self._news.set()

    def _take_frames(self) -> None:
        heard_s = self._clock.now_s()
        while not self._ending.is_set():
            frame = self._source(SLICE_S)
            now_s = self._clock.now_s()
            if frame is not None:
                heard_s = now_s
                with self._lock:
                    self._account(frame)
                self._news.set()
            elif now_s - heard_s > self._silence_s:
                raise self._timeout(f"a frame within {self._silence_s:g} s", "none")

    def _account(self, frame: Frame) -> None:
        if not self._losses.see(frame):
            return
        if frame.flags:
            self._losses.add(LossKind.DAMAGED, frame.sequence, 1, frame)
        elif len(self._queue) >= self._capacity:
            self._losses.add(LossKind.OVERFLOW, frame.sequence, 1, frame)
        else:
            self._queue.append(frame)
            self._taken += 1

    def _timeout(self, expected: str, got: str) -> DeviceTimeout:
        return DeviceTimeout(self._device, "stream", expected, got, "check cable and power of the camera")


def _nothing() -> None:
    """Do nothing. `close` calls `on_close` once; this function takes its place in later calls."""


class StreamingCamera(Camera, Protocol):
    """A `Camera` that also delivers all its frames. `grab` is refused while a stream is open."""

    def stream(self, capacity: int = CAPACITY) -> FrameStream:
        """Return a stream of all frames from now on, with room for `capacity` frames."""
