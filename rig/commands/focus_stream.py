"""Show the figures of the cameras on a terminal or as lines, and obey the keys, until the person ends it."""

import math
import os
import threading
from collections.abc import Callable
from itertools import count
from pathlib import Path

from dic.shell.bottom_lines import bottom_lines
from drivers.clock import Clock
from drivers.terminal.keys import Keys
from rig import RigError
from rig.commands.check import Image
from rig.commands.focus_view import FocusPanel, sentence
from rig.commands.focusing import Focus

REFRESHES_PER_S = 4.0
TOLD_EVERY_S = 10.0
"""Shortest time in s between two lines, where no terminal shows the figures."""
_POLL_S = 0.1
_FIRST_S = 2.0
"""The first line is printed after this time in s, when most cameras have images."""


class FocusStream:
    """Streams the figures of all cameras.

    Parameters
    ----------
    focus : Focus
    clock : Clock
        A real clock.
    say : callable
        Called with each line to print.
    keep : callable or None
        Called with a name and an image to keep it; None if there is no folder for images.
    folder : Path or None
        The folder of the images.
    """

    def __init__(
        self,
        focus: Focus,
        clock: Clock,
        say: Callable[[str], None],
        keep: Callable[[str, Image], None] | None,
        folder: Path | None,
    ) -> None:
        self._focus, self._clock, self._say = focus, clock, say
        self._keep, self._folder = keep, folder
        self._note, self._ends = "", False
        self._told_s = -math.inf

    def follow(self, seconds: float | None) -> None:
        """Stream for some time, or until the key for the end or Ctrl-C is pressed."""
        keys = Keys().there
        live = bottom_lines(
            lambda: FocusPanel(self._focus, self._clock.now_s(), self._note, keys), REFRESHES_PER_S
        )
        until_s = self._clock.now_s() + (math.inf if seconds is None else seconds)
        self._told_s = self._clock.now_s() - TOLD_EVERY_S + _FIRST_S
        self._focus.begin()
        try:
            if live is None:
                self._wait(until_s, drawn=False)
            else:
                with live, _KeyThread(self._obey):
                    self._wait(until_s, drawn=True)
        finally:
            self._focus.end()
        if self._focus.failure:
            raise RigError("focus", "figures of the images", self._focus.failure, "report this")

    def _wait(self, until_s: float, *, drawn: bool) -> None:
        while not (self._ends or self._focus.over) and self._clock.now_s() < until_s:
            self._clock.sleep(_POLL_S)
            if not drawn and self._clock.now_s() - self._told_s >= TOLD_EVERY_S:
                self._told_s = self._clock.now_s()
                self._say(sentence(self._focus, self._told_s))

    def _obey(self, key: str) -> None:
        """Do what a key asks for. Another key has no effect."""
        if key == "q":
            self._ends = True
        elif key == "r":
            for each in self._focus.cameras:
                each.forget_best()
        elif key == "s":
            self._note = self._save()

    def _save(self) -> str:
        """Keep the newest images under names that are free, and return what to tell."""
        if self._keep is None or self._folder is None:
            return "no image was saved: name a folder with -o"
        folder = self._folder
        names = [each.camera_name for each in self._focus.cameras]
        number = next(n for n in count(1) if not any((folder / f"{name}-{n}.png").exists() for name in names))
        try:
            kept = self._focus.keep(self._keep, f"-{number}")
        except RigError as error:
            return str(error)
        return f"saved in {folder}: {', '.join(f'{name}.png' for name in kept) or 'no image yet'}"


class _KeyThread(threading.Thread):
    """Reads keys while its context is entered, if there is a terminal to read from."""

    def __init__(self, obey: Callable[[str], None]) -> None:
        super().__init__(name="keys", daemon=True)
        self._obey, self._keys = obey, Keys()
        self._wakes, self._waking = os.pipe()
        self._left = False

    def __enter__(self) -> None:
        if self._keys.there:
            self.start()

    def __exit__(self, *_: object) -> None:
        self._left = True
        os.write(self._waking, b"x")
        if self.ident is not None:
            self.join(1.0)

    def run(self) -> None:
        """Give each key to `obey`."""
        while not self._left:
            if key := self._keys.next(self._wakes).casefold():
                self._obey(key)
