"""Read single keys at the terminal of a program, while nothing asks a question there."""

import os
import select
import signal
import termios
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import cast

STDIN = 0
_LOCAL = 3  # the place of the local flags among the settings of a terminal
FOREGROUND_S = 0.5
"""A program in the background of the terminal checks at this interval, in s, whether it is still there."""


class Keys:
    """The keys that a person presses at a terminal, one by one and without an echo.

    Ctrl-C and the other keys that send a signal still send it. A program in the background of the terminal
    reads nothing.

    `descriptor` is the file descriptor of the terminal.
    """

    def __init__(self, descriptor: int = STDIN) -> None:
        self._descriptor = descriptor

    @property
    def there(self) -> bool:
        """True if the descriptor is a terminal."""
        try:
            return os.isatty(self._descriptor)
        except OSError:
            return False

    def next(self, wakes: int) -> str:
        """Return the next key, or an empty text if a byte can be read from the descriptor `wakes`.

        In the background of the terminal, return an empty text from time to time. The terminal is as before
        when this method returns.
        """
        with self._single_keys() as listening:
            listened = [wakes, self._descriptor] if listening else [wakes]
            ready = select.select(listened, [], [], None if listening else FOREGROUND_S)[0]
            if self._descriptor not in ready:
                return ""
            # A terminal that was closed can be read and has nothing, or its reading fails.
            with suppress(OSError):
                return os.read(self._descriptor, 1).decode(errors="replace")
        return ""

    @contextmanager
    def _single_keys(self) -> Iterator[bool]:
        """Let the terminal give keys at once. Yield False if the program must not read from it."""
        # Blocked, these signals do not suspend a program that uses the terminal from the background. A
        # suspended program would not watch its machine.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTTIN, signal.SIGTTOU})
        try:
            usual = self._usual()
            if usual is None:
                yield False
                return
            single = [*usual]
            single[_LOCAL] = cast(int, usual[_LOCAL]) & ~(termios.ICANON | termios.ECHO)
            termios.tcsetattr(self._descriptor, termios.TCSANOW, single)
            try:
                yield True
            finally:
                with suppress(termios.error):
                    termios.tcsetattr(self._descriptor, termios.TCSANOW, usual)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)

    def _usual(self) -> list[int | list[bytes | int]] | None:
        """Return the settings of the terminal, or None in its background or if there is none."""
        try:
            if os.tcgetpgrp(self._descriptor) != os.getpgrp():
                return None
        except OSError:
            # the terminal is not the program's controlling terminal, so there is no background
            pass
        try:
            return termios.tcgetattr(self._descriptor)
        except (termios.error, OSError):
            return None
