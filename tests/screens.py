"""Programs on a pseudo-terminal, with the text of the screen as a person sees it."""

import codecs
import fcntl
import os
import pty
import re
import select
import signal
import struct
import subprocess
import termios
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

from drivers.clock import SystemClock

ROWS = 24
_CODE = re.compile(r"\x1b\[([?\d;]*)([A-Za-z])")


class Screen:
    """The text that a terminal shows after it has received `feed`; colours are ignored.

    Parameters
    ----------
    columns : int
    rows : int
        Number of lines of the terminal; older lines are scrolled away.

    Attributes
    ----------
    seen : list of str
        The text of every screen, recorded when its newest line is complete and the cursor goes back. So the
        result does not depend on how the terminal divides the output into pieces.
    """

    def __init__(self, columns: int, rows: int = ROWS) -> None:
        self._columns, self._rows = columns, rows
        self._lines: list[list[str]] = [[]]
        self._row = self._column = 0
        self._rest = ""
        self.seen: list[str] = []

    def feed(self, text: str) -> None:
        """Process text that a program has written."""
        text = self._rest + text
        self._rest = ""
        position = 0
        while position < len(text):
            sign = text[position]
            if sign == "\x1b":
                code = _CODE.match(text, position)
                if code is None:
                    # the rest of the code comes with the next text
                    self._rest = text[position:]
                    return
                self._control(code[1], code[2])
                position = code.end()
                continue
            self._write(sign)
            position += 1

    @property
    def lines(self) -> list[str]:
        """The lines that the terminal shows now, without the lines that are scrolled away."""
        return ["".join(line).rstrip() for line in self._lines[-self._rows :]]

    def __str__(self) -> str:
        return "\n".join(self.lines).rstrip()

    def note(self) -> None:
        """Append the present screen to `seen`, unless it is equal to the last element."""
        if not self.seen or self.seen[-1] != str(self):
            self.seen.append(str(self))

    def _write(self, sign: str) -> None:
        if sign == "\r":
            self.note()
            self._column = 0
        elif sign == "\n":
            self._row += 1
            self._reach_row()
        elif sign == "\b":
            self._column = max(0, self._column - 1)
        elif sign >= " ":
            if self._column >= self._columns:
                self._row, self._column = self._row + 1, 0
                self._reach_row()
            line = self._lines[self._row]
            line.extend(" " * (self._column + 1 - len(line)))
            line[self._column] = sign
            self._column += 1

    def _reach_row(self) -> None:
        while len(self._lines) <= self._row:
            self._lines.append([])

    def _control(self, numbers: str, letter: str) -> None:
        count = int(numbers or 0) if numbers.isdecimal() or not numbers else 0
        line = self._lines[self._row]
        if letter == "A":
            self._row = max(0, self._row - max(1, count))
        elif letter == "B":
            self._row += max(1, count)
            self._reach_row()
        elif letter == "K" and count == 2:
            line.clear()
        elif letter == "K":
            del line[self._column :]
        elif letter == "J":
            del line[self._column :]
            del self._lines[self._row + 1 :]
        else:
            assert letter in "mhl", f"this screen does not know the code {numbers}{letter}"


class TerminalProgram:
    """A program on its own pseudo-terminal. A test reads the screen and types.

    Parameters
    ----------
    command : sequence of str
    columns : int
    folder : Path
        The working folder of the program.
    """

    def __init__(self, command: Sequence[str], columns: int, folder: Path) -> None:
        self.screen = Screen(columns)
        self._decoder = codecs.getincrementaldecoder("utf-8")("replace")
        self._ours, theirs = _terminal(columns)
        self.process = subprocess.Popen(
            command,
            stdin=theirs,
            stdout=theirs,
            stderr=theirs,
            cwd=folder,
            # a session of its own, with this terminal as its controlling terminal
            preexec_fn=lambda: (os.setsid(), fcntl.ioctl(0, termios.TIOCSCTTY, 0))[0],
            env={**os.environ, "TERM": "xterm", "COLUMNS": "", "LINES": ""},
        )
        os.close(theirs)

    def type(self, keys: str) -> None:
        """Type on the terminal; ``\\x03`` is Ctrl-C."""
        os.write(self._ours, keys.encode())

    def wait_for(self, text: str, timeout_s: float = 60.0) -> str:
        """Read until the screen shows a text, and return the screen."""
        end_s = SystemClock().now_s() + timeout_s
        while text not in str(self.screen):
            left_s = end_s - SystemClock().now_s()
            going_on = left_s > 0.0 and self._read(left_s)
            assert going_on, f"{text!r} is not on the screen:\n{self.screen}"
        return str(self.screen)

    def end(self) -> int:
        """Read the output to the end of the program, and return its exit status."""
        while self._read(60.0):
            pass
        self.screen.note()
        return self.process.wait(60.0)

    def close(self) -> None:
        """Kill the program if it has not ended, and close the terminal."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGKILL)
            self.process.wait()
        os.close(self._ours)

    def _read(self, timeout_s: float) -> bool:
        """Read the next piece of output; return False at the end of the output."""
        assert select.select([self._ours], [], [], timeout_s)[0], f"nothing comes any more:\n{self.screen}"
        try:
            received = os.read(self._ours, 10_000)
        except OSError:
            # the program has closed the terminal
            return False
        self.screen.feed(self._decoder.decode(received))
        return bool(received)


class Watched:
    """A terminal for commands in this process, whose screens are recorded."""

    def __init__(self, columns: int) -> None:
        self._screen = Screen(columns, rows=1000)

    @property
    def seen(self) -> list[str]:
        """The text of every screen; see `Screen.seen`."""
        return self._screen.seen

    @property
    def lines(self) -> list[str]:
        """The lines that the terminal shows now."""
        return str(self._screen).splitlines()

    def read(self, descriptor: int) -> None:
        """Process all text from a descriptor, up to its end."""
        # A character may be cut by the end of a piece.
        decoder = codecs.getincrementaldecoder("utf-8")()
        try:
            while received := os.read(descriptor, 65536):
                self._screen.feed(decoder.decode(received))
        except OSError:
            # the other side is closed
            pass
        self._screen.note()


@contextmanager
def terminal(columns: int) -> Iterator[tuple[TextIO, Watched]]:
    """Yield a stream to a terminal, and its recorded screens, which are complete after the block."""
    ours, theirs = _terminal(columns)
    watched = Watched(columns)
    reader = threading.Thread(target=watched.read, args=(ours,))
    reader.start()
    try:
        with os.fdopen(theirs, "w", buffering=1, encoding="utf-8") as stream:
            yield stream, watched
    finally:
        reader.join()
        os.close(ours)


def _terminal(columns: int) -> tuple[int, int]:
    """Return the descriptors of both sides of a new pseudo-terminal: the test's and the program's."""
    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", ROWS, columns, 0, 0))
    return ours, theirs
