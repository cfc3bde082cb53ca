"""Serial port to which a Newport ESP301 is connected.

The controller's answers have no number, but come in the order of the questions. Therefore, after a missing or
unexpected answer, the driver asks for the controller's version and discards all answers that come before the
version. A command without an answer, such as a stop, is sent without waiting for other answers.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from drivers.clock import SystemClock
from drivers.errors import DeviceTimeout
from drivers.lines.channel import CHANNEL_ERRORS, Channel, OvertakenError
from drivers.lines.request_turn import RequestTurn
from drivers.stages.esp301.protocol import END, MODEL
from drivers.stages.port import StagePort

ATTEMPTS = 2
LINE_MAX = 512
SHOWN_MAX = 80

T = TypeVar("T")


class EspPort(StagePort):
    """An exclusive port to an ESP301. No other program can use it, and any thread may call its methods."""

    def __init__(self, name: str, channel: Channel, reply_timeout_s: float) -> None:
        super().__init__(name, channel, reply_timeout_s)
        self._clock = SystemClock()
        self._turn = RequestTurn()
        self._buffer = b""
        # check the first answer, because answers to the questions of an earlier program may still arrive
        self._suspect = True
        self._owed = False
        self.version = ""

    def send(self, command: str, permit: Callable[[], None] | None = None) -> None:
        """Send a command that has no answer.

        `permit` is a function that is called just before the bytes are sent. If the function raises, nothing
        is sent. Raise `LinkLost` if the connection to the controller is lost.
        """
        with self._write_lock:
            self._write(command.encode("ascii") + END, command, permit)

    def ask(self, question: str, read: Callable[[str], T], attempts: int = ATTEMPTS) -> T:
        """Ask a question and return the answer. Repeat the question if no valid answer comes.

        ``read(line)`` returns the value in a line, or raises `ValueError` if the line is not the answer.
        `attempts` is the largest number of attempts. A question that a stop interrupted is repeated in any
        case. May raise `DeviceTimeout` or `LinkLost`.
        """
        attempt = 0
        while True:
            attempt += 1
            try:
                with self._turn.ordinary():
                    return self._attempt(question, read, attempt)
            except OvertakenError:
                attempt -= 1
            except DeviceTimeout:
                if attempt >= attempts or self.call_time.left_s == 0:
                    raise

    def _attempt(self, question: str, read: Callable[[str], T], attempt: int) -> T:
        """Ask a question once. If the first attempt gets no answer in time, try to receive it late."""
        wait = self.call_time.first_wait_s if attempt == 1 else self.call_time.last_wait_s
        try:
            return self._answer(question, read, self._turn.wake, wait(self._reply_timeout_s))
        except DeviceTimeout as silence:
            if attempt > 1 or not self._owed:
                raise
            try:
                (line,) = self._owed_answers()
                return read(line)
            except (DeviceTimeout, ValueError):
                # there is not exactly one late line, or this line is not the answer
                raise silence from None

    def _owed_answers(self) -> list[str]:
        """Ask for the version. Return the lines that come before it, which are late answers."""
        found = []
        timeout_s = self.call_time.last_wait_s(self._reply_timeout_s)
        deadline_s = self._clock.now_s() + timeout_s
        with self._losing("VE?"):
            self.send("VE?")
            while (line := self._line("VE?", self._turn.wake, timeout_s, deadline_s)) != self.version:
                found.append(line)
        self._suspect = False
        return found

    def ask_first(self, question: str, read: Callable[[str], T], at_most_s: float) -> T:
        """Ask a question ahead of all waiting questions, and check that the answer belongs to this question.

        ``read(line)`` returns the value in a line, or raises `ValueError` if the line is not the answer.
        `at_most_s` is the upper limit of the wait for an answer, in seconds, even if the reply timeout is
        longer. May raise `DeviceTimeout` or `LinkLost`.
        """
        timeout_s = min(self._reply_timeout_s, at_most_s)
        with self._turn.urgent():
            answer, line = self._answer(question, lambda line: (read(line), line), None, timeout_s)
            with self._losing("VE?"):
                self._prove(line, timeout_s)
            return answer

    def close(self) -> None:
        """Release the port. A repeated call has no effect."""
        with self._turn.urgent():
            self._lost = self._lost or "the port was closed"
            self._channel.close()
        self._turn.close()

    def _answer(self, question: str, read: Callable[[str], T], wake: int | None, timeout_s: float) -> T:
        suspect, self._suspect = self._suspect, True
        self._owed = False
        with self._losing(question):
            if suspect:
                self._resynchronise(wake, timeout_s)
            self._buffer = b""
            self._channel.drain()
            self.send(question)
            # the controller owes exactly one answer until `_line` has received it
            self._owed = True
            line = self._line(question, wake, timeout_s, self._clock.now_s() + timeout_s)
            self._owed = False
        try:
            answer = read(line)
        except ValueError as error:
            raise self._timeout(question, timeout_s, str(error)[:SHOWN_MAX]) from None
        # A repeated, identical answer is harmless. If two answers differ, nobody knows which one is right.
        for other in self._buffer.split(b"\n")[:-1]:
            if _text(other) != line:
                raise self._timeout(question, timeout_s, f"{line!r} and {_text(other)[:SHOWN_MAX]!r}")
        self._suspect = False
        return answer

    @contextmanager
    def _losing(self, question: str) -> Iterator[None]:
        """Raise `LinkLost` if the channel fails now or has failed before."""
        if self._lost is not None:
            raise self._link_lost(question)
        try:
            yield
        except CHANNEL_ERRORS as error:
            self._lost = self._lost or str(error)
            raise self._link_lost(question) from error

    def _resynchronise(self, wake: int | None, timeout_s: float) -> None:
        """Ask for the controller's version and discard all lines before the version."""
        self.send("VE?")
        deadline_s = self._clock.now_s() + timeout_s
        while True:
            line = self._line("VE?", wake, timeout_s, deadline_s)
            if MODEL.fullmatch(line) and self.version in ("", line):
                self.version = line
                return

    def _prove(self, answer: str, timeout_s: float) -> None:
        """Check that `answer` belongs to the latest question.

        The function asks for the controller's version. Nothing but the version may come after `answer`.
        """
        self._suspect = True
        self.send("VE?")
        deadline_s = self._clock.now_s() + timeout_s
        while (line := self._line("VE?", None, timeout_s, deadline_s)) == answer:
            pass
        if line != self.version:
            raise self._timeout("VE?", timeout_s, f"{line[:SHOWN_MAX]!r} instead of {self.version!r}")
        self._suspect = False

    def _line(self, question: str, wake: int | None, timeout_s: float, deadline_s: float) -> str:
        """Return the next complete line from the buffer or the channel. Raise an error at the deadline."""
        while b"\n" not in self._buffer:
            data = self._channel.receive(deadline_s, wake)
            if not data or len(self._buffer) > LINE_MAX:
                got = f"the part {self._buffer[:SHOWN_MAX]!r}" if self._buffer else "silence"
                raise self._timeout(question, timeout_s, got)
            self._buffer += data
        line, _, self._buffer = self._buffer.partition(b"\n")
        if self._clock.now_s() > deadline_s:
            raise self._timeout(question, timeout_s, f"other lines, the last {_text(line)[:SHOWN_MAX]!r}")
        return _text(line)


def _text(line: bytes) -> str:
    return line.decode("ascii", "backslashreplace").strip()
