"""Warnings about many images, of which only one is told now and then."""

from collections.abc import Callable

from drivers.clock import Clock

SELDOM_S = 10.0


class SeldomWarnings:
    """Tells the first warning of each source at once, and later ones at most every `SELDOM_S`.

    `tell` is called with a sentence.
    """

    def __init__(self, clock: Clock, tell: Callable[[str], None]) -> None:
        self._clock, self._tell = clock, tell
        self._told_s: dict[str, float] = {}
        self._newest: dict[str, tuple[int, str]] = {}

    def warn(self, source: str, sentence: str) -> None:
        """Tell a warning of a source, or count it."""
        count, _ = self._newest.get(source, (0, ""))
        self._newest[source] = count + 1, sentence
        if self._clock.now_s() - self._told_s.get(source, -SELDOM_S) >= SELDOM_S:
            self._tell_newest(source)

    def finish(self) -> None:
        """Tell the newest warning of each source that was not told."""
        for source in list(self._newest):
            self._tell_newest(source)

    def _tell_newest(self, source: str) -> None:
        count, sentence = self._newest.pop(source)
        self._told_s[source] = self._clock.now_s()
        self._tell(sentence if count == 1 else f"{sentence} (one of {count} such warnings)")
