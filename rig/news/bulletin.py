"""The numbered events of a run, for any number of readers."""

import threading
from collections import deque
from datetime import datetime
from itertools import islice
from typing import Any

from drivers.clock import SystemClock
from rig.news import wording
from rig.news.wording import About

KEPT_EVENTS = 10_000
"""Number of latest events that are kept. A slower reader gets an event that says how many it has missed."""


class Bulletin:
    """Numbered events. Each reader remembers its own last number, so a slow reader delays no other reader."""

    def __init__(self, about: About) -> None:
        self._about = about
        self._clock = SystemClock()
        self._events: deque[dict[str, Any]] = deque(maxlen=KEPT_EVENTS)
        self._added = 0
        self._closed = False
        self._changed = threading.Condition()

    def add(self, event: dict[str, Any]) -> None:
        """Append an event, with its number and the date and time. Events after `close` are ignored."""
        with self._changed:
            if self._closed:
                return
            self._added += 1
            utc = text_of(self._clock.utc())
            self._events.append({**wording.head(self._about), "n": self._added, "utc": utc, **event})
            self._changed.notify_all()

    def close(self) -> None:
        """Accept no more events, because the run has ended."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    @property
    def closed(self) -> bool:
        """True if no event will follow."""
        return self._closed

    @property
    def last(self) -> int:
        """The number of the newest event, or 0 before the first event."""
        return self._added

    def since(self, number: int, most: int = 1000) -> list[dict[str, Any]]:
        """Return at most `most` events, oldest first, that follow the event with a given number.

        If some of these events are not kept any more, the first event of the result is a ``gap``.
        """
        with self._changed:
            first_kept = self._added - len(self._events) + 1
            start = max(number + 1, first_kept) - first_kept
            found = list(islice(self._events, start, start + most))
            missed = first_kept - number - 1
        if missed > 0:
            gap = {**wording.head(self._about), "n": first_kept - 1, "event": "gap", "missed": missed}
            return [gap, *found]
        return found

    def wait_for(self, number: int, timeout_s: float) -> bool:
        """Wait for an event after a number, or for the bulletin to close. Return False after the timeout."""
        with self._changed:
            return self._changed.wait_for(lambda: self._added > number or self._closed, timeout_s)


def text_of(utc: datetime) -> str:
    """Return a date and time as text, to the millisecond."""
    return utc.isoformat(timespec="milliseconds").replace("+00:00", "Z")
