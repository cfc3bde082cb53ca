"""Call the listeners of a run on threads of their own, so that no listener can delay the run."""

import threading
from collections import deque
from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import Generic, TypeVar

from drivers.clock import SystemClock

T = TypeVar("T")

QUEUED_NEWS = 1000
"""Largest number of reports that wait for one listener. If more arrive, the oldest ones are dropped."""
LEAVING_S = 1.0
"""Real time, in s, for all listeners together to handle the reports that still wait at the end of a run."""


class Listeners(Generic[T]):
    """Calls several functions (listeners) with the same reports of a run, each on a thread of its own.

    Each listener receives the reports, such as a `Status`, in their order. If a listener raises an exception,
    the listener is not called again. If a listener is too slow, the oldest reports that wait for it are
    dropped.

    Parameters
    ----------
    listeners : iterable of callable
    end_run : callable
        Called with a reason if a listener raises `KeyboardInterrupt` or `SystemExit`, which request the end
        of the run.
    """

    def __init__(self, listeners: Iterable[Callable[[T], None]], end_run: Callable[[str], None]) -> None:
        self._listeners = [_Listener(listener, end_run) for listener in listeners]

    def tell(self, news: T) -> list[str]:
        """Give a report to all listeners without waiting for them. Return a sentence for each new failure."""
        for listener in self._listeners:
            listener.put(news)
        return self._failures()

    def close(self, end_s: float) -> list[str]:
        """Wait until the listeners have handled the waiting reports. Return a sentence per failure or loss.

        Parameters
        ----------
        end_s : float
            Time on the system's clock at which the wait ends.
        """
        for listener in self._listeners:
            listener.leave()
        for listener in self._listeners:
            listener.join_until(end_s)
        return self._failures() + [sentence for each in self._listeners for sentence in each.losses()]

    def _failures(self) -> list[str]:
        return [sentence for each in self._listeners for sentence in each.take_failures()]


class _Listener(threading.Thread, Generic[T]):
    """The thread of one listener, with the reports that wait for this listener."""

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
        with self._changed:
            self._leaving = True
            self._changed.notify()

    def join_until(self, end_s: float) -> None:
        if self.ident is not None:
            self.join(max(0.0, end_s - SystemClock().now_s()))

    def take_failures(self) -> list[str]:
        taken = []
        with suppress(IndexError):
            while True:
                taken.append(self._failures.popleft())
        return taken

    def losses(self) -> list[str]:
        with self._changed:
            lost = self._lost + len(self._waiting)
        if self.is_alive():
            return [f"{self.name}: does not return from a call; it has missed {lost} news"]
        return [f"{self.name}: was too slow and has missed {lost} news"] if lost and not self._failed else []

    def run(self) -> None:
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
