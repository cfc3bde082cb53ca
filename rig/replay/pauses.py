"""The pauses of an archived run, which its replay makes at the same readings."""

import re
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from rig.recorder.records import GOES_ON, PAUSED

_BEGINNING = re.compile(rf"{re.escape(PAUSED)} (-?\d+) \((.*?)\) by ")
_NEVER = 2**62


@dataclass(frozen=True)
class RecordedPause:
    """A pause: its step, the place in the step, and the numbers of readings before it and before its end."""

    step: int
    place: str
    begins: int
    ends: int = _NEVER


def recorded_pauses(events: Iterable[tuple[str, int]]) -> list[RecordedPause]:
    """Return the pauses of a run from its events: each message, and the number of readings before it.

    A pause in which the run ended has no end.
    """
    found: list[RecordedPause] = []
    for message, count in events:
        if said := _BEGINNING.match(message):
            found.append(RecordedPause(int(said[1]), said[2], count))
        elif message.startswith(f"{GOES_ON} by ") and found:
            last = found.pop()
            found.append(RecordedPause(last.step, last.place, last.begins, count))
    return found


class RecordedPauses:
    """Tells the engine of a replay when to pause. `taken` returns the number of readings so far."""

    def __init__(self, pauses: Iterable[RecordedPause], taken: Callable[[], int]) -> None:
        self._left = deque(pauses)
        self._taken = taken

    def asked(self, step: int, place: str) -> str:
        """Return a text where the recorded run was paused, and an empty text elsewhere."""
        if not self._left:
            return ""
        due = self._left[0]
        return "the record" if (due.step, due.place, due.begins) == (step, place, self._taken()) else ""

    def take_over(self) -> str:
        """Return a text when the replay has taken as many readings as the run when it went on."""
        if self._taken() < self._left[0].ends:
            return ""
        self._left.popleft()
        return "the record"
