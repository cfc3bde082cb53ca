"""Frames as fast as the camera gives them, with an account of every one that is missing."""

import threading
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from enum import Enum
from typing import Self

from drivers.clock import Clock
from drivers.errors import DeviceError, DeviceTimeout
from drivers.interfaces import Frame

CAPACITY = 64
SLICE_S = 0.1
"""How long the thread waits at a time before it looks whether it shall end."""
IN_A_ROW = 8
"""So many frames must all come late before time says that some were not counted."""


OVERTAKEN = 64
"""A counter that goes back by less is a frame that comes late, by more a counter that began anew."""


class LossKind(Enum):
    """How it is known that frames are missing."""

    GAP = "the camera's counter jumped"
    PAUSE = "more time went by than the camera's counter says"
    REPEAT = "the camera's counter did not grow"
    DAMAGED = "frames with an error flag"
    OVERFLOW = "the program did not take its frames in time"


@dataclass(frozen=True)
class Loss:
    """Missing frames in a row.

    Attributes
    ----------
    kind : LossKind
    first : int
        Sequence number of the first one missing; for `LossKind.REPEAT` that of the frame at which it was
        noticed, for `LossKind.PAUSE` that of the first frame that came late, to within eight.
    count : int
        How many; 0 for a counter that did not grow, since the frame itself is there.
    time_s : float
        When it was noticed, on the rig's clock.
    """

    kind: LossKind
    first: int
    count: int
    time_s: float


@dataclass(frozen=True)
class StreamReport:
    """What became of the frames of a stream.

    Attributes
    ----------
    taken : int
        Whole frames that were queued for the program.
    losses : tuple of Loss
    """

    taken: int
    losses: tuple[Loss, ...]

    @property
    def lost(self) -> int:
        """How many frames are missing in all."""
        return sum(loss.count for loss in self.losses)


class FrameStream:
    """A thread that takes frames from a camera into a bounded queue; use it as a context manager.

    Frames with error flags are not delivered. When the queue is full the newest frame is dropped. Nothing is
    dropped, skipped or found missing that `report` does not tell.

    Parameters
    ----------
    device : str
        For messages.
    source : callable
        ``source(timeout_s)`` returns the next frame, or None when the time is over; it raises `DeviceError`.
    clock : Clock
    interval_s : float
        From one frame to the next.
    silence_s : float
        After how long without a frame the camera counts as stalled.
    capacity : int
        Of the queue.
    on_close : callable
        Called once the thread has ended.
    """

    def __init__(
        self,
        device: str,
        source: Callable[[float], Frame | None],
        clock: Clock,
        *,
        interval_s: float,
        silence_s: float,
        capacity: int = CAPACITY,
        on_close: Callable[[], None],
    ) -> None:
        self._device = device
        self._source = source
        self._clock = clock
        self._interval_s = interval_s
        self._silence_s = silence_s
        self._capacity = capacity
        self._on_close = on_close
        self._queue: deque[Frame] = deque()
        self._news = threading.Condition()
        self._ending = threading.Event()
        self._error: DeviceError | None = None
        self._last: Frame | None = None
        self._delays: deque[tuple[int, float]] = deque(maxlen=IN_A_ROW)
        self._taken = 0
        self._losses: list[Loss] = []
        self._thread = threading.Thread(target=self._fill, name=f"stream {device}", daemon=True)
        self._thread.start()

    def next(self, timeout_s: float) -> Frame:
        """Return the oldest frame that waits.

        Raises
        ------
        DeviceTimeout
            If none comes in time.
        DeviceError
            What ended the stream, once the frames before it are taken.
        """
        with self._news:
            self._news.wait_for(lambda: self._queue or self._error or self._ending.is_set(), timeout_s)
            if self._queue:
                return self._queue.popleft()
            if self._error is not None:
                raise self._error
        got = "none, since the stream was closed" if self._ending.is_set() else "none"
        raise self._timeout(f"a frame within {timeout_s:g} s", got)

    def report(self) -> StreamReport:
        """Return the account up to now."""
        with self._news:
            return StreamReport(self._taken, tuple(self._losses))

    def close(self) -> None:
        """End the thread; frames that wait can still be taken. Harmless when repeated."""
        if self._ending.is_set():
            return
        self._ending.set()
        self._thread.join()
        with self._news:
            self._news.notify_all()
        self._on_close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __iter__(self) -> Iterator[Frame]:
        """Yield frames until the stream is closed; raises what ended it otherwise."""
        while True:
            try:
                yield self.next(self._silence_s)
            except DeviceTimeout:
                if self._ending.is_set():
                    return
                raise

    def _fill(self) -> None:
        heard_s = self._clock.now_s()
        while not self._ending.is_set():
            try:
                frame = self._source(SLICE_S)
                now_s = self._clock.now_s()
                if frame is None:
                    if now_s - heard_s > self._silence_s:
                        raise self._timeout(f"a frame within {self._silence_s:g} s", "none")
                    continue
            except DeviceError as error:
                with self._news:
                    self._error = error
                    self._news.notify_all()
                return
            heard_s = now_s
            with self._news:
                self._account(frame)
                self._news.notify_all()

    def _account(self, frame: Frame) -> None:
        if self._is_late(frame):
            return
        last, self._last = self._last, frame
        if last is not None:
            self._compare(last, frame)
        if frame.flags:
            self._lose(LossKind.DAMAGED, frame.sequence, 1, frame)
        elif len(self._queue) >= self._capacity:
            self._lose(LossKind.OVERFLOW, frame.sequence, 1, frame)
        else:
            self._queue.append(frame)
            self._taken += 1

    def _is_late(self, frame: Frame) -> bool:
        """Tell a frame that the next ones have overtaken: its packets were sent again by a network camera.

        It was counted as missing, or came damaged before, and stays so: frames are delivered in order.
        """
        if self._last is None or not -OVERTAKEN < frame.sequence - self._last.sequence < 0:
            return False
        if not any(loss.first <= frame.sequence < loss.first + loss.count for loss in self._losses):
            self._lose(LossKind.REPEAT, frame.sequence, 0, frame)
        return True

    def _compare(self, last: Frame, frame: Frame) -> None:
        steps = frame.sequence - last.sequence
        if steps > 1:
            self._lose(LossKind.GAP, last.sequence + 1, steps - 1, frame)
        elif steps < 1:
            self._lose(LossKind.REPEAT, frame.sequence, 0, frame)
        self._compare_time(frame, began_anew=steps < 0)

    def _compare_time(self, frame: Frame, *, began_anew: bool) -> None:
        """Find frames that the camera did not count, by the time that the counter leaves unexplained.

        A frame may come late, but not early: the least delay of some frames in a row tells their true pace.
        If they all were late, a later one will show it.
        """
        if began_anew:
            self._delays.clear()
        full = len(self._delays) == IN_A_ROW
        before_s = min(delay_s for _, delay_s in self._delays) if full else 0.0
        self._delays.append((frame.sequence, frame.exposed_s - frame.sequence * self._interval_s))
        after_s = min(delay_s for _, delay_s in self._delays)
        uncounted = round((after_s - before_s) / self._interval_s)
        if full and uncounted > 0:
            self._lose(LossKind.PAUSE, self._delays[0][0], uncounted, frame)
        elif full and uncounted < 0:
            self._withdraw(-uncounted)

    def _withdraw(self, count: int) -> None:
        """Take back what was said missing by its time: a frame has come that is too early for that."""
        for index in range(len(self._losses) - 1, -1, -1):
            loss = self._losses[index]
            if loss.kind is LossKind.PAUSE and count > 0:
                held = min(count, loss.count)
                count -= held
                if held == loss.count:
                    del self._losses[index]
                else:
                    self._losses[index] = replace(loss, count=loss.count - held)

    def _lose(self, kind: LossKind, first: int, count: int, frame: Frame) -> None:
        last = self._losses[-1] if self._losses else None
        if last is not None and last.kind is kind is LossKind.OVERFLOW and last.first + last.count == first:
            self._losses[-1] = replace(last, count=last.count + count)
        else:
            self._losses.append(Loss(kind, first, count, frame.received_s))

    def _timeout(self, expected: str, got: str) -> DeviceTimeout:
        return DeviceTimeout(
            self._device, "stream", expected=expected, got=got, remedy="check cable and power of the camera"
        )
