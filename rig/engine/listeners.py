"""Call the listeners of a run on threads of their own, so that no listener can delay the run."""

import threading
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from typing import Generic, TypeVar

from drivers.clock import SystemClock

T = TypeVar("T")

QUEUED_NEWS = 1000
"""Largest number of reports that wait for one listener. If more arrive, the oldest ones are dropped."""
LEAVING_S = 1.0
"""Real time, in s, for all listeners together to handle the reports that still wait at the end of a run."""


class Listener(threading.Thread, Generic[T]):
    """The thread of one listener, with the reports that wait for this listener.

    The listener receives the reports in their order. If it raises an exception, it is not called again. If
    it is too slow, the oldest reports that wait for it are dropped. `end_run` is called with a reason if it
    raises `KeyboardInterrupt` or `SystemExit`, which request the end of the run.
    """

    def __init__(self, listener: Callable[[T], None], end_run: Callable[[str], None]) -> None:
        name = getattr(listener, "__qualname__", type(listener).__qualname__)
        super().__init__(name=f"listener {name}", daemon=True)
        self._listener = listener
        self._end_run = end_run
        self._waiting: deque[T] = deque(maxlen=QUEUED_NEWS)
        self._changed = threading.Condition()
        self._leaving = self._failed = False
        self._lost = 0
        self._failures: deque[str] = deque()

    def put(self, news: T) -> None:
        """Give a report to the listener without waiting for it."""
        with self._changed:
            if self._failed:
                return
            self._lost += len(self._waiting) == QUEUED_NEWS
            self._waiting.append(news)
            self._changed.notify()
        if self.ident is None:
            try:
                self.start()
            except RuntimeError as error:
                self._fail(error)

    def leave(self) -> None:
        """Let the thread end after the waiting reports."""
        with self._changed:
            self._leaving = True
            self._changed.notify()

    def join_until(self, end_s: float) -> None:
        """Wait for the end of the thread, until a time on the system's clock."""
        if self.ident is not None:
            self.join(max(0.0, end_s - SystemClock().now_s()))

    def take_failures(self) -> list[str]:
        """Return a sentence for each new failure."""
        taken = []
        with suppress(IndexError):
            while True:
                taken.append(self._failures.popleft())
        return taken

    def losses(self) -> list[str]:
        """Return a sentence if the listener missed reports."""
        with self._changed:
            lost = self._lost + len(self._waiting)
        if self.is_alive():
            return [f"{self.name}: does not return from a call; it has missed {lost} news"]
        return [f"{self.name}: was too slow and has missed {lost} news"] if lost and not self._failed else []

    def run(self) -> None:
        """Call the listener with each report."""
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._waiting or self._leaving)
                if not self._waiting:
                    return
                news = self._waiting.popleft()
            try:
                self._listener(news)
            except BaseException as error:
                self._fail(error)
                if not isinstance(error, Exception):
                    self._end_run(f"{self.name}: {type(error).__name__}")
                return

    def _fail(self, error: BaseException) -> None:
        self._failures.append(f"{self.name}: {type(error).__name__}: {error}; it is not called again")
        with self._changed:
            self._failed = True
            self._waiting.clear()
