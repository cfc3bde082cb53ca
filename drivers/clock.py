"""The only clock of the program: no other module may sleep or read the time.

A run takes its clock as an argument. A `VirtualClock` simulates hours of a protocol in seconds; the same code
runs a real rig on the `SystemClock`.
"""

import threading
import time
from datetime import UTC, datetime, timedelta
from typing import Protocol


class Clock(Protocol):
    """Monotonic time, waiting, and date and time."""

    def now_s(self) -> float:
        """Seconds since an arbitrary start; never goes back."""

    def sleep(self, duration_s: float) -> None:
        """Wait for `duration_s` seconds of this clock's time."""

    def utc(self) -> datetime:
        """Date and time now, timezone-aware, in UTC."""


class SystemClock:
    """The machine's own time."""

    def now_s(self) -> float:
        """Seconds of the system's monotonic clock (the clock of V4L2's frame timestamps)."""
        return time.monotonic()

    def sleep(self, duration_s: float) -> None:
        """Block the calling thread for `duration_s` seconds."""
        time.sleep(max(0.0, duration_s))

    def utc(self) -> datetime:
        """Date and time of the system, in UTC."""
        return datetime.now(UTC)


class VirtualClock:
    """Simulated time: only calls of `sleep` advance the clock, without waiting.

    Parameters
    ----------
    start : datetime, optional
        The date at simulated second 0. The default is a fixed date, so that runs are reproducible bit by bit.
    """

    def __init__(self, start: datetime = datetime(2026, 1, 1, 8, 0, tzinfo=UTC)) -> None:
        self._start = start
        self._now_s = 0.0
        self._lock = threading.Lock()

    def now_s(self) -> float:
        """Simulated seconds since the start."""
        with self._lock:
            return self._now_s

    def sleep(self, duration_s: float) -> None:
        """Advance simulated time by `duration_s` seconds without waiting."""
        with self._lock:
            self._now_s += max(0.0, duration_s)

    def utc(self) -> datetime:
        """Simulated date and time."""
        return self._start + timedelta(seconds=self.now_s())
