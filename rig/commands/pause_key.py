"""Pause a run by a key at its terminal, and let it go on by a word."""

import math
import os
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager

from drivers.clock import SystemClock
from drivers.terminal.keys import Keys
from drivers.terminal.question import Question, Withdrawn
from rig import Engine

KEY, WORD = "p", "continue"
IMAGE_KEY, END_KEY = "i", "e"
TWICE_S = 2.0
"""The images of an acquisition end if the key for it is pressed twice within this time in s."""
BY = "the person at the terminal"
LEAVING_S = 1.0
"""Longest time in s for which the end of a run waits until the terminal is as before."""


class PauseKey(threading.Thread):
    """Listens to the terminal during a run: a key pauses the run, and a word lets it go on.

    A single key is enough to pause, because a pause is safe. To go on takes a word, because then the machine
    moves again. During an acquisition a key asks for an image, and one that is pressed twice ends the images,
    which nothing brings back. A pause that another program requested is shown and ended here too.

    Parameters
    ----------
    engine : Engine
    free : callable
        Returns a context manager that frees the terminal for a question.
    """

    def __init__(
        self, engine: Engine, free: Callable[[], AbstractContextManager[None]], keys: Keys | None = None
    ) -> None:
        super().__init__(name="pause key", daemon=True)
        self._engine, self._free, self._keys = engine, free, keys or Keys()
        self._wakes, self._waking = os.pipe()
        self._turn = threading.Condition()
        self._uses, self._lent, self._paused, self._ended = False, 0, False, False
        self._question: Question | None = None
        self._clock, self._end_pressed_s = SystemClock(), -math.inf

    def tell(self, *, paused: bool) -> None:
        """Tell whether the run is paused now. Any thread may call this method."""
        with self._turn:
            if self._paused == paused:
                return
            self._paused = paused
            self._wake()

    @contextmanager
    def lent(self) -> Iterator[None]:
        """Leave the terminal to another reader within the `with` block."""
        with self._turn:
            self._lent += 1
            self._wake()
            self._turn.wait_for(lambda: not self._uses)
        try:
            yield
        finally:
            with self._turn:
                self._lent -= 1
                self._turn.notify_all()

    def leave(self) -> None:
        """End, and leave the terminal as it was."""
        with self._turn:
            self._ended = True
            self._wake()
        self.join(LEAVING_S)

    def run(self) -> None:
        """Listen until `leave` is called."""
        while True:
            with self._turn:
                self._turn.wait_for(lambda: self._ended or not self._lent)
                if self._ended:
                    return
                self._uses, paused = True, self._paused
            try:
                if paused:
                    self._ask()
                else:
                    self._obey(self._keys.next(self._wakes).casefold())
                self._forget_waking()
            finally:
                with self._turn:
                    self._uses = False
                    self._turn.notify_all()

    def _obey(self, key: str) -> None:
        """Do what a key asks for. A key that makes no sense now has no effect."""
        if key == KEY:
            self._engine.pause(BY, at_machine=True)
        elif key == IMAGE_KEY:
            self._engine.request_image()
        elif key == END_KEY:
            now_s = self._clock.now_s()
            if now_s - self._end_pressed_s <= TWICE_S:
                self._engine.request_end()
            self._end_pressed_s = now_s

    def _ask(self) -> None:
        """Ask for the word that lets the run go on, until it is typed or the pause ends otherwise."""
        question = Question("The run is paused.", WORD, "Ctrl-C to end the run", request="to let it go on")
        with self._turn:
            self._question = question
            if self._ended or self._lent or not self._paused:
                question.withdraw()
        try:
            with self._free():
                question.ask()
                self._engine.go_on(BY, at_machine=True)
                with self._turn:
                    # The engine needs a moment. Until then, the question must not come again.
                    self._turn.wait_for(lambda: self._ended or self._lent or not self._paused)
        except Withdrawn:
            pass
        except EOFError:
            self._engine.abort("the terminal was closed during a pause")
            with self._turn:
                self._turn.wait_for(lambda: self._ended or self._lent or not self._paused)
        finally:
            with self._turn:
                self._question = None
            question.close()

    def _wake(self) -> None:
        """Wake this thread from its wait for a key or for a word. `_turn` is held."""
        os.write(self._waking, b"x")
        if self._question is not None:
            self._question.withdraw()
        self._turn.notify_all()

    def _forget_waking(self) -> None:
        with self._turn:
            os.set_blocking(self._wakes, False)
            try:
                while os.read(self._wakes, 64):
                    pass
            except BlockingIOError:
                pass
