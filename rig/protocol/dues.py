"""When the images of an acquisition are due: at times, at events of a channel, or when the operator asks."""

import math
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Iterator, Sequence
from itertools import count

import numpy as np

from rig.protocol.step import RigReading


class Dues:
    """Tells the times on the rig's clock at which images are due. This one knows none: a camera decides."""

    def begin(self, begun_s: float) -> None:
        """Begin to count times at `begun_s` on the rig's clock."""

    def see(self, reading: RigReading) -> None:
        """Look for events in a new reading. Call this method once with each reading."""

    def next_s(self) -> float | None:
        """Return the time of the next image that is not returned yet, or None as long as it is unknown.

        A known time may lie ahead.
        """
        return None


class TimedDues(Dues):
    """Images at given times after the beginning, in s. `interval_s` is NaN if they have no fixed one."""

    def __init__(self, times_s: Sequence[float] | Iterator[float]) -> None:
        self._left = iter(times_s)
        self._begun_s = math.nan

    @classmethod
    def every(cls, interval_s: float) -> "TimedDues":
        """Return images at a fixed rate, the first one at the beginning."""
        return cls(number * interval_s for number in count())

    def begin(self, begun_s: float) -> None:
        """Begin to count times."""
        self._begun_s = begun_s

    def next_s(self) -> float | None:
        """Return the time of the next image; infinity after the last one."""
        return self._begun_s + next(self._left, math.inf)


class SignalDues(Dues, ABC):
    """Images at events of a signal, which every sample is searched for."""

    def __init__(self, signal: str) -> None:
        self._signal = signal
        self._waiting: deque[float] = deque()
        self._begun_s = math.inf

    def begin(self, begun_s: float) -> None:
        """Begin to look for events."""
        self._begun_s = begun_s

    def see(self, reading: RigReading) -> None:
        """Search the new samples of the signal."""
        found = reading.signals.get(self._signal)
        if found is not None and found.is_new:
            for time_s, value in zip(found.time_s.tolist(), found.values.tolist(), strict=True):
                if time_s >= self._begun_s and self._happens(value):
                    self._waiting.append(time_s)

    def next_s(self) -> float | None:
        """Return the time of the next event, its delay subtracted."""
        return self._waiting.popleft() if self._waiting else None

    @abstractmethod
    def _happens(self, value: float) -> bool:
        """Return True if the event happens with this sample."""


class IncrementDues(SignalDues):
    """An image whenever a signal has changed by an increment since the last one; the first one at once."""

    def __init__(self, signal: str, increment: float) -> None:
        super().__init__(signal)
        self._increment = increment
        self._last: float | None = None

    def _happens(self, value: float) -> bool:
        if self._last is None:
            self._last = value
            return True
        steps = np.trunc((value - self._last) / self._increment)
        if steps:
            # Count whole increments, so that the noise of one sample does not shift all later images.
            self._last += float(steps) * self._increment
        return bool(steps)


class EdgeDues(SignalDues):
    """An image whenever a signal rises above a level, or falls below it."""

    def __init__(self, signal: str, level: float, *, rising: bool) -> None:
        super().__init__(signal)
        self._level, self._rising = level, rising
        self._was_beyond = True

    def _happens(self, value: float) -> bool:
        beyond = value > self._level if self._rising else value < self._level
        happens = beyond and not self._was_beyond
        self._was_beyond = beyond
        return happens


class AskedDues(Dues):
    """An image whenever the operator asks for one. `ask` may be called from any thread."""

    def __init__(self) -> None:
        self._asked: deque[float] = deque()

    def ask(self, now_s: float) -> None:
        """Ask for an image now."""
        self._asked.append(now_s)

    def next_s(self) -> float | None:
        """Return the time at which the operator asked."""
        return self._asked.popleft() if self._asked else None
