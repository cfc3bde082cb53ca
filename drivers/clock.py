"""The only clock of the program: no other module may sleep or read the time.

Every run receives its clock as an argument. With a `VirtualClock`, a test of several hours is simulated in
seconds. With the `SystemClock`, the same code controls a real rig in real time.
"""

import heapq
import math
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import nullcontext
from datetime import UTC, datetime, timedelta
from typing import Protocol


class Event:
    """A flag, which is set or not set. A thread can wait with `Clock.wait` until the flag is set."""

    def __init__(self) -> None:
        self._flag = threading.Event()
        self._watchers: list[Callable[[], None]] = []

    def set(self) -> None:
        """Set the flag and wake all threads that wait for it."""
        self._flag.set()
        for watcher in tuple(self._watchers):
            watcher()

    def clear(self) -> None:
        """Reset the flag."""
        self._flag.clear()

    def is_set(self) -> bool:
        """Return whether the flag is set."""
        return self._flag.is_set()

    def wait_really(self, timeout_s: float) -> bool:
        """Wait until the flag is set, at most `timeout_s` seconds of real time. Return whether it is set."""
        return self._flag.wait(min(max(0.0, timeout_s), threading.TIMEOUT_MAX))

    def watch(self, watcher: Callable[[], None]) -> None:
        """Call the function `watcher` whenever the flag is set."""
        self._watchers.append(watcher)

    def unwatch(self, watcher: Callable[[], None]) -> None:
        """Stop calling the function `watcher`, which was given to `watch` before."""
        self._watchers.remove(watcher)


class Activity(Protocol):
    """Work of one thread, announced with `Clock.activity`. Simulated time stands still until its `end`.

    The thread that does the work uses the activity as a context manager.
    """

    def __enter__(self) -> object:
        """Begin the work of this activity on the current thread."""

    def __exit__(self, *_: object) -> None:
        """End the activity."""

    def end(self) -> None:
        """Let simulated time pass without this activity. Any thread may call this method, also repeatedly."""


class GivenUp(BaseException):
    """Raised in a thread that sleeps or waits on simulated time after its activity was ended by another
    thread."""


class Clock(Protocol):
    """Interface of a clock: monotonic time, sleeping, waiting for events, date and time."""

    def now_s(self) -> float:
        """Return the seconds since an arbitrary start. This time never decreases."""

    def sleep(self, duration_s: float) -> None:
        """Wait for `duration_s` seconds of this clock's time."""

    def wait(self, event: Event, timeout_s: float, real_timeout_s: float = math.inf) -> bool:
        """Wait until `event` is set or a timeout has passed. Return whether `event` is set.

        Parameters
        ----------
        event : Event
        timeout_s : float
            Seconds of this clock's time.
        real_timeout_s : float
            Seconds of real time. Real time also passes during work that takes no simulated time.
        """

    def activity(self, *, at_once: bool = False) -> Activity:
        """Announce the work of a thread. Simulated time stands still while the thread works.

        Call `activity` before the work is given to its thread, so that no simulated time passes before it
        begins.

        Parameters
        ----------
        at_once : bool
            True to begin at the same time as other activities. Otherwise activities on a simulated clock take
            turns. One activity works while all others sleep or wait, and their order is always the same.
        """

    def utc(self) -> datetime:
        """Date and time now, timezone-aware, in UTC."""


class SystemClock:
    """A `Clock` on the real time of this computer."""

    def now_s(self) -> float:
        """Return the seconds of the system's monotonic clock, which also gives the timestamps of V4L2
        frames."""
        return time.monotonic()

    def sleep(self, duration_s: float) -> None:
        """Block the calling thread for `duration_s` seconds."""
        time.sleep(max(0.0, duration_s))

    def wait(self, event: Event, timeout_s: float, real_timeout_s: float = math.inf) -> bool:
        """Block the calling thread until `event` is set, at most for the shorter of both timeouts."""
        return event.wait_really(min(timeout_s, real_timeout_s))

    def activity(self, *, at_once: bool = False) -> Activity:
        """Return an activity without any effect, because real time passes in any case."""
        return _RealActivity()

    def utc(self) -> datetime:
        """Date and time of the system, in UTC."""
        return datetime.now(UTC)


class _RealActivity(nullcontext[None]):
    def end(self) -> None:
        pass


class VirtualClock:
    """Simulated time, which passes only while every activity sleeps or waits.

    When all activities sleep or wait, the clock jumps to the earliest time at which one of them continues.
    Activities take turns: first in the order of the times at which they continue, then in the order of their
    announcement. So a run with several threads gives the same results in every repetition. Simulated time
    passes even while a thread without an `activity` works. If there is no activity at all, each sleep ends at
    once. If another thread has ended the activity of a thread, `sleep` and `wait` raise `GivenUp` in this
    thread.

    Parameters
    ----------
    start : datetime, optional
        Date and time at simulated second 0. The default is a fixed date, so that repeated runs give identical
        results.
    """

    def __init__(self, start: datetime = datetime(2026, 1, 1, 8, 0, tzinfo=UTC)) -> None:
        self._start = start
        self._now_s = 0.0
        self._lock = threading.Lock()
        self._of_thread = threading.local()
        self._activities: set[_VirtualActivity] = set()
        self._running: set[_VirtualActivity] = set()
        self._ready: deque[_Pause] = deque()
        self._sleeping: list[tuple[float, int, _Pause]] = []
        self._pauses = 0

    def now_s(self) -> float:
        """Simulated seconds since the start."""
        with self._lock:
            return self._now_s

    def sleep(self, duration_s: float) -> None:
        """Let simulated time pass until `duration_s` seconds are over."""
        if duration_s > 0.0:
            self._pause(duration_s, None, math.inf)

    def wait(self, event: Event, timeout_s: float, real_timeout_s: float = math.inf) -> bool:
        """Let simulated time pass until `event` is set or one of the two timeouts has passed.

        An event that is set by a thread without an activity wakes the waiting thread immediately.
        """
        self._pause(max(0.0, timeout_s), event, real_timeout_s)
        return event.is_set()

    def activity(self, *, at_once: bool = False) -> Activity:
        """Announce work of a thread, for which simulated time stands still."""
        made = _VirtualActivity(self)
        with self._lock:
            self._activities.add(made)
            if at_once:
                self._resume(made.pause)
            else:
                self._ready.append(made.pause)
            self._proceed()
        return made

    def utc(self) -> datetime:
        """Simulated date and time."""
        return self._start + timedelta(seconds=self.now_s())

    def _pause(self, duration_s: float, event: Event | None, real_timeout_s: float) -> None:
        pause = _Pause(self._current())

        def wake() -> None:
            self._wake(pause)

        if event is not None:
            event.watch(wake)
        try:
            with self._lock:
                self._require_waited_for(pause)
                if event is not None and event.is_set():
                    pause.over = True
                    return
                if pause.activity is None and not self._activities and duration_s < math.inf:
                    self._now_s += duration_s
                    return
                if duration_s < math.inf:
                    self._pauses += 1
                    heapq.heappush(self._sleeping, (self._now_s + duration_s, self._pauses, pause))
                if pause.activity is not None:
                    pause.activity.pause = pause
                    self._running.discard(pause.activity)
                self._proceed()
            pause.gate.acquire(timeout=min(real_timeout_s, threading.TIMEOUT_MAX))
            with self._lock:
                self._resume(pause)
                self._require_waited_for(pause)
        finally:
            if event is not None:
                event.unwatch(wake)

    def _require_waited_for(self, pause: "_Pause") -> None:
        if not (pause.activity is None or pause.activity in self._activities):
            raise GivenUp

    def _current(self) -> "_VirtualActivity | None":
        activity: _VirtualActivity | None = getattr(self._of_thread, "activity", None)
        return activity

    def _wake(self, pause: "_Pause") -> None:
        """End the pause of a thread early, because an event was set.

        If an activity has set the event, the woken thread continues at its turn, otherwise at once.
        """
        with self._lock:
            if self._current() in self._running:
                self._ready.append(pause)
            else:
                self._resume(pause)

    def _resume(self, pause: "_Pause") -> None:
        if pause.over:
            return
        pause.over = True
        if pause.activity in self._activities:
            self._running.add(pause.activity)
        pause.gate.release()

    def _proceed(self) -> None:
        """If no activity is working, let the next one work. Advance the clock first if all of them sleep."""
        while not self._running:
            if self._ready:
                self._resume(self._ready.popleft())
            elif self._sleeping:
                wake_s, _, pause = heapq.heappop(self._sleeping)
                if not pause.over:
                    self._now_s = max(self._now_s, wake_s)
                    self._resume(pause)
            else:
                return

    def _enter(self, activity: "_VirtualActivity") -> "_VirtualActivity | None":
        """Wait for the turn of `activity`, make it the current thread's activity, and return the previous
        one."""
        previous = self._current()
        if previous in self._activities:
            # The current thread already has an activity, and one activity for each thread is enough.
            self._leave(activity)
            return previous
        activity.pause.gate.acquire()
        self._of_thread.activity = activity
        return previous

    def _restore(self, previous: "_VirtualActivity | None") -> None:
        """Make `previous` the activity of the current thread again."""
        self._of_thread.activity = previous

    def _leave(self, activity: "_VirtualActivity") -> None:
        """Remove an activity, so that simulated time passes without it."""
        with self._lock:
            self._activities.discard(activity)
            self._running.discard(activity)
            self._resume(activity.pause)
            self._proceed()


class _VirtualActivity:
    """An `Activity` on a virtual clock. `pause` is its latest sleep or wait.

    The first `pause` of an activity is the wait for its turn.
    """

    def __init__(self, clock: VirtualClock) -> None:
        self._clock = clock
        self.pause = _Pause(self)
        self._previous: _VirtualActivity | None = None

    def __enter__(self) -> None:
        self._previous = self._clock._enter(self)

    def __exit__(self, *_: object) -> None:
        self._clock._restore(self._previous)
        self.end()

    def end(self) -> None:
        self._clock._leave(self)


class _Pause:
    """The pause of a thread that sleeps or waits. The lock `gate` is released when the pause ends."""

    def __init__(self, activity: _VirtualActivity | None) -> None:
        self.activity = activity
        self.over = False
        self.gate = threading.Lock()
        self.gate.acquire()
