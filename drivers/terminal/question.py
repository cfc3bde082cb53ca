"""Ask the person at the terminal to type a word. Old input is discarded, and the wait can be ended."""

import os
import select
import signal
import sys
import termios
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress

STDIN = 0
FOREGROUND_S = 0.2
"""A program in the background of the terminal checks at this interval, in s, whether it is still there."""
SHOWN_MAX = 20
WRONG_LINES_MAX = 20
"""Largest number of wrong lines from a pipe or a file. If more come, a program writes them, not a person."""

NOT_A_TERMINAL = (
    "Standard input is no terminal. Lines that were sent before this question count: each wrong line is "
    "skipped, and the first line with the word answers the question."
)


class Withdrawn(Exception):
    """The question was withdrawn before it was answered."""


class Question:
    """A question that a person answers by typing one word and Enter at the terminal.

    Text that was typed at a terminal before the question appeared is discarded. After a wrong word the
    question is asked again. From a pipe or a file, lines that were written before the question are read too.

    Parameters
    ----------
    text : str
        Action that the person must do, in one line.
    word : str
        The word that answers the question. Capital letters and spaces around the word do not matter.
    otherwise : str
        What the person can do instead of answering, such as ``Ctrl-C to end the run``.
    descriptor : int
        The file descriptor to read from.
    request : str
        Meaning of the word, as shown in the question.
    """

    def __init__(
        self,
        text: str,
        word: str,
        otherwise: str,
        descriptor: int = STDIN,
        *,
        request: str = "when it is done",
    ) -> None:
        self._text = text
        self._word = word
        self._request = f"Type {word} {request}, {otherwise}: "
        self._descriptor = descriptor
        self._withdrawal, self._withdrawing = os.pipe()
        self._lock = threading.Lock()
        self._closed = False

    def ask(self) -> None:
        """Show the question on standard error, and return when the word was typed.

        Raise `EOFError` if the terminal is closed, if the person typed Ctrl-D, or if a pipe or a file has
        ended, and `Withdrawn` if `withdraw` was called.
        """
        with self._in_control_of_terminal():
            self._forget_old_input()
            _show(f"{self._text}\n{self._request}")
            wrong = 0
            try:
                while (typed := self._line()).casefold() != self._word.casefold():
                    wrong += 1
                    if wrong > WRONG_LINES_MAX and not self._is_terminal:
                        raise EOFError
                    _show(f"{_shown(typed)} is not the word. {self._request}")
            except BaseException:
                # end the line of the question, so that the next output begins on a new line
                _show("\n")
                raise

    def withdraw(self) -> None:
        """End `ask` now. Any thread may call this method, even before `ask` is called."""
        with self._lock:
            if not self._closed:
                os.write(self._withdrawing, b"x")

    def close(self) -> None:
        """Release this question's descriptors after `ask` has ended. A later `withdraw` does nothing."""
        with self._lock:
            self._closed = True
            os.close(self._withdrawal)
            os.close(self._withdrawing)

    @property
    def _is_terminal(self) -> bool:
        return os.isatty(self._descriptor)

    @contextmanager
    def _in_control_of_terminal(self) -> Iterator[None]:
        """Prevent the system from suspending this program when it uses the terminal from the background.

        A suspended program would not monitor the load frame and the stage.
        """
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTTIN, signal.SIGTTOU})
        try:
            yield
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)

    def _forget_old_input(self) -> None:
        if self._is_terminal:
            with suppress(termios.error):
                termios.tcflush(self._descriptor, termios.TCIFLUSH)
        else:
            _show(f"{NOT_A_TERMINAL}\n")

    def _line(self) -> str:
        """Return the next line without spaces around it."""
        # read single bytes, so that the lines after this line are left for other readers
        line = b""
        while not line.endswith(b"\n"):
            self._wait()
            try:
                read = os.read(self._descriptor, 1)
            except OSError as error:
                if self._is_terminal and not self._in_foreground():
                    continue
                raise EOFError from error
            if not read:
                raise EOFError
            line = (line + read)[-1000:]
        return line.decode(errors="replace").strip()

    def _wait(self) -> None:
        """Wait until a byte can be read. Raise `Withdrawn` if the question was withdrawn."""
        while True:
            in_foreground = self._in_foreground()
            listened = [self._withdrawal, self._descriptor] if in_foreground else [self._withdrawal]
            ready = select.select(listened, [], [], None if in_foreground else FOREGROUND_S)[0]
            if self._withdrawal in ready:
                raise Withdrawn
            if self._descriptor in ready:
                return

    def _in_foreground(self) -> bool:
        if not self._is_terminal:
            return True
        try:
            return os.tcgetpgrp(self._descriptor) == os.getpgrp()
        except OSError:
            # the terminal is not the program's controlling terminal, so the program is not in its background
            return True


def _show(text: str) -> None:
    # use standard error, because standard output may be redirected to a file
    with suppress(OSError):
        print(text, end="", file=sys.stderr, flush=True)


def _shown(typed: str) -> str:
    readable = "".join(sign if sign.isprintable() else "?" for sign in typed)
    return f'"{readable[:SHOWN_MAX]}{"…" if len(readable) > SHOWN_MAX else ""}"'
