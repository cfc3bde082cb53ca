"""A port to a device that answers each question with a line of text, in the order of the questions.

The answers have no number. So after a missing or unexpected answer, an old answer could be mistaken for a new
one. The port therefore asks a question whose answer cannot be mistaken, and discards all lines before this
answer. If the device has no such question, the port asks once, and discards all lines until the line is
silent. A command without an answer, such as a stop, is sent without waiting for other answers.
"""

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TypeVar

from drivers.clock import SystemClock
from drivers.errors import DeviceTimeout
from drivers.lines.channel import CHANNEL_ERRORS, Channel, OvertakenError
from drivers.lines.device_port import DevicePort
from drivers.lines.request_turn import RequestTurn

ATTEMPTS = 2
LINE_MAX = 512
SHOWN_MAX = 80
# Longest time for which lines are discarded, in reply timeouts. A device that sends longer is assumed to
# send by itself.
DISCARDED_TIMEOUTS = 4

T = TypeVar("T")


@dataclass(frozen=True)
class Proof:
    """A question whose answer cannot be the answer to another question, such as the name of the device.

    ``is_answer(line)`` tells whether a line can be the answer. The port also expects that the device always
    gives the same answer. `expected` describes the answer in error messages.
    """

    question: str
    is_answer: Callable[[str], bool]
    expected: str = "its own answer"


@dataclass(frozen=True)
class LineSyntax:
    """How a device and its port send lines.

    Attributes
    ----------
    end : bytes
        The end of each message to the device. A line of the device may end with CR, LF or both.
    proof : Proof, optional
    encoding : str
    is_ignored : callable, optional
        ``is_ignored(line)`` tells whether a line of the device is no answer, for example a prompt.
    """

    end: bytes = b"\n"
    proof: Proof | None = None
    encoding: str = "ascii"
    is_ignored: Callable[[str], bool] | None = None


class LinePort(DevicePort):
    """An exclusive port to a device that answers with lines. Any thread may call its methods.

    Attributes
    ----------
    proven : str
        The first answer to the question of `LineSyntax.proof`, or an empty text.
    """

    def __init__(
        self, name: str, channel: Channel, reply_timeout_s: float, syntax: LineSyntax = LineSyntax()
    ) -> None:
        super().__init__(name, channel, reply_timeout_s)
        self._syntax = syntax
        self._clock = SystemClock()
        self._turn = RequestTurn()
        self._buffer = b""
        # check the first answer, because answers to the questions of an earlier program may still arrive
        self._suspect = True
        self._owed = False
        self.proven = ""

    def send(self, command: str, permit: Callable[[], None] | None = None) -> None:
        """Send a command that has no answer.

        `permit` is a function that is called just before the bytes are sent. If the function raises, nothing
        is sent. Raise `LinkLost` if the connection to the device is lost.
        """
        with self._write_lock:
            self._write(command.encode(self._syntax.encoding) + self._syntax.end, command, permit)

    def ask(
        self,
        question: str,
        read: Callable[[str], T],
        attempts: int = ATTEMPTS,
        permit: Callable[[], None] | None = None,
    ) -> T:
        """Ask a question and return the answer. Repeat the question if no valid answer comes.

        ``read(line)`` returns the value in a line, or raises `ValueError` if the line is not the answer.
        `attempts` is the largest number of attempts. A question that a stop interrupted is repeated in any
        case. `permit` is described for `send`; a command to move needs one that raises after a stop. May
        raise `DeviceTimeout` or `LinkLost`.
        """
        attempt = 0
        while True:
            attempt += 1
            try:
                with self._turn.ordinary():
                    return self._attempt(question, read, attempt, permit)
            except OvertakenError:
                attempt -= 1
            except DeviceTimeout:
                if attempt >= attempts or self.call_time.left_s == 0:
                    raise

    def ask_first(self, question: str, read: Callable[[str], T], at_most_s: float) -> T:
        """Ask a question ahead of all waiting questions, and check that the answer belongs to this question.

        ``read(line)`` returns the value in a line, or raises `ValueError` if the line is not the answer.
        `at_most_s` is the upper limit of the wait for an answer, in seconds, even if the reply timeout is
        longer. The port needs a `Proof`. May raise `DeviceTimeout` or `LinkLost`.
        """
        proof = self._syntax.proof
        if proof is None:
            raise ValueError("an urgent question needs a question that proves the order of the answers")
        timeout_s = min(self._reply_timeout_s, at_most_s)
        with self._turn.urgent():
            answer, line = self._answer(question, lambda line: (read(line), line), None, timeout_s)
            if question != proof.question:
                with self._losing(proof.question):
                    self._prove(proof, line, timeout_s)
            return answer

    def settle(self) -> None:
        """Discard answers to earlier questions and to commands, before the next question.

        Without a `Proof`, wait until nothing arrives for the reply timeout. May raise `DeviceTimeout` or
        `LinkLost`.
        """
        self._suspect = True
        if self._syntax.proof is None and not self._channel.is_cleared_by_discard:
            with self._turn.ordinary(), self._losing("nothing"):
                self._discard_until_silent("nothing", self._turn.wake, self._reply_timeout_s)
            self._suspect = False

    def close(self) -> None:
        """Release the port. A repeated call has no effect."""
        with self._turn.urgent():
            self._lost = self._lost or "the port was closed"
            self._channel.close()
        self._turn.close()

    def _attempt(
        self, question: str, read: Callable[[str], T], attempt: int, permit: Callable[[], None] | None
    ) -> T:
        """Ask a question once. If the first attempt gets no answer in time, try to receive it late."""
        wait = self.call_time.first_wait_s if attempt == 1 else self.call_time.last_wait_s
        proof = self._syntax.proof
        try:
            return self._answer(question, read, self._turn.wake, wait(self._reply_timeout_s), permit)
        except DeviceTimeout as silence:
            if attempt > 1 or not self._owed or proof is None:
                raise
            try:
                (line,) = self._owed_answers(proof)
                return read(line)
            except (DeviceTimeout, ValueError):
                # there is not exactly one late line, or this line is not the answer
                raise silence from None

    def _owed_answers(self, proof: Proof) -> list[str]:
        """Ask the proving question. Return the lines that come before its answer, which are late answers."""
        found = []
        timeout_s = self.call_time.last_wait_s(self._reply_timeout_s)
        deadline_s = self._clock.now_s() + timeout_s
        with self._losing(proof.question):
            self.send(proof.question)
            while (line := self._line(proof.question, self._turn.wake, timeout_s, deadline_s)) != self.proven:
                found.append(line)
        self._suspect = False
        return found

    def _answer(
        self,
        question: str,
        read: Callable[[str], T],
        wake: int | None,
        timeout_s: float,
        permit: Callable[[], None] | None = None,
    ) -> T:
        suspect, self._suspect = self._suspect, True
        self._owed = False
        with self._losing(question):
            if suspect:
                self._resynchronise(question, wake, timeout_s)
                timeout_s = min(timeout_s, self.call_time.left_s)
            self._buffer = b""
            self._channel.drain()
            self.send(question, permit)
            # the device owes exactly one answer until `_line` has received it
            self._owed = True
            deadline_s = self._clock.now_s() + timeout_s
            while self._is_proof(line := self._line(question, wake, timeout_s, deadline_s), question):
                continue
            self._owed = False
        try:
            answer = read(line)
        except ValueError as error:
            raise self._timeout(question, timeout_s, str(error)[:SHOWN_MAX]) from None
        # A repeated, identical answer is harmless. If two answers differ, nobody knows which one is right.
        *others, rest = _split(self._buffer)
        for other in filter(None, map(self._text, others)):
            if other != line and not self._is_ignored(other):
                raise self._timeout(question, timeout_s, f"{line!r} and {other[:SHOWN_MAX]!r}")
        # the end of a line that has only begun would later be taken for an answer
        self._suspect = bool(rest.strip())
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

    def _resynchronise(self, question: str, wake: int | None, timeout_s: float) -> None:
        """Make sure that no answer to an earlier question can arrive any more."""
        if self._channel.is_cleared_by_discard:
            self._channel.discard()
        if self._channel.is_cleared_by_discard:
            return
        if self._syntax.proof is not None:
            self._ask_proof(self._syntax.proof, wake, timeout_s)
        else:
            # some devices send a late answer only after the next question
            self.send(question)
            self._discard_until_silent(question, wake, min(timeout_s, self._reply_timeout_s))

    def _ask_proof(self, proof: Proof, wake: int | None, timeout_s: float) -> None:
        """Ask the proving question and discard all lines before its answer."""
        self.send(proof.question)
        deadline_s = self._clock.now_s() + timeout_s
        other = ""
        while True:
            try:
                line = self._line(proof.question, wake, timeout_s, deadline_s)
            except DeviceTimeout:
                if other:
                    got = f"{other[:SHOWN_MAX]!r} instead of {self.proven or proof.expected}"
                    raise self._timeout(proof.question, timeout_s, got) from None
                raise
            if proof.is_answer(line) and self.proven in ("", line):
                self.proven = line
                return
            other = line

    def _discard_until_silent(self, question: str, wake: int | None, silence_s: float) -> None:
        """Discard everything until the device has been silent for some time."""
        end_s = self._clock.now_s() + DISCARDED_TIMEOUTS * silence_s
        while self._channel.receive(self._clock.now_s() + silence_s, wake):
            if self._clock.now_s() > end_s:
                raise self._timeout(question, silence_s, "lines without an end")

    def _prove(self, proof: Proof, answer: str, timeout_s: float) -> None:
        """Check that `answer` belongs to the latest question.

        The function asks the proving question. Nothing but its answer may come after `answer`.
        """
        self._suspect = True
        self.send(proof.question)
        deadline_s = self._clock.now_s() + timeout_s
        while (line := self._line(proof.question, None, timeout_s, deadline_s)) == answer:
            pass
        if line != self.proven:
            raise self._timeout(proof.question, timeout_s, f"{line[:SHOWN_MAX]!r} instead of {self.proven!r}")
        self._suspect = False

    def _line(self, question: str, wake: int | None, timeout_s: float, deadline_s: float) -> str:
        """Return the next complete line from the buffer or the channel. Raise an error at the deadline."""
        while True:
            line, found, rest = _cut(self._buffer)
            if found:
                self._buffer = rest
                text = self._text(line)
                if self._clock.now_s() > deadline_s:
                    got = f"other lines, the last {text[:SHOWN_MAX]!r}"
                    raise self._timeout(question, timeout_s, got)
                if text and not self._is_ignored(text):
                    return text
                continue
            data = self._channel.receive(deadline_s, wake)
            if not data or len(self._buffer) > LINE_MAX:
                got = f"the part {self._buffer[:SHOWN_MAX]!r}" if self._buffer.strip() else "silence"
                raise self._timeout(question, timeout_s, got)
            self._buffer += data

    def _is_proof(self, line: str, question: str) -> bool:
        """Return whether a line is the answer to the proving question, which came twice, and to no other."""
        proof = self._syntax.proof
        return proof is not None and line == self.proven and question != proof.question

    def _text(self, line: bytes) -> str:
        return line.decode(self._syntax.encoding, "backslashreplace").strip()

    def _is_ignored(self, line: str) -> bool:
        return self._syntax.is_ignored is not None and self._syntax.is_ignored(line)


def _split(buffer: bytes) -> list[bytes]:
    """Return the complete lines of a buffer, and what follows them."""
    return re.split(rb"[\r\n]", buffer)


def _cut(buffer: bytes) -> tuple[bytes, bool, bytes]:
    """Return the first line of a buffer, whether it is complete, and what follows it."""
    line, *rest = re.split(rb"[\r\n]", buffer, maxsplit=1)
    return line, bool(rest), rest[0] if rest else b""
