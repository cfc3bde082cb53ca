"""A serial port with a Newport ESP301 behind it.

Its answers carry no number, but come in the order of the questions. So after a missing or strange answer the
controller is asked for its version, and everything before that answer is thrown away. A command that has no
answer, such as a stop, waits for nobody's answer.
"""

import threading
from collections.abc import Callable
from typing import TypeVar

from drivers.channel import CHANNEL_ERRORS, OvertakenError, open_channel
from drivers.clock import SystemClock
from drivers.errors import DeviceTimeout, LinkLost
from drivers.esp301_protocol import END, MODEL
from drivers.turn import Turn

ATTEMPTS = 2

T = TypeVar("T")


class EspPort:
    """An exclusively opened port; its methods may be called from any thread.

    Parameters
    ----------
    name : str
        The device's name and port, for messages.
    url : str
        A serial device's path, or ``socket://host:port``.
    baud : int
    reply_timeout_s : float
        Deadline for a complete answer, in real time.

    Raises
    ------
    LinkLost
        If the port cannot be opened.
    """

    def __init__(self, name: str, url: str, baud: int, reply_timeout_s: float) -> None:
        self.name = name
        self._reply_timeout_s = reply_timeout_s
        self._clock = SystemClock()
        self._turn = Turn()
        self._write_lock = threading.Lock()
        self._buffer = b""
        # what a program before left on the line is not ours
        self._suspect = True
        self._lost: str | None = None
        self.version = ""
        try:
            self._channel = open_channel(url, baud, reply_timeout_s)
        except CHANNEL_ERRORS as error:
            self._turn.close()
            raise LinkLost(
                name,
                "open port",
                expected="a free serial port",
                got=str(error),
                remedy="check path and cable, and that no other program holds the port",
            ) from error

    def send(self, command: str, permit: Callable[[], None] | None = None) -> None:
        """Send a command that has no answer.

        Parameters
        ----------
        command : str
        permit : callable, optional
            Called just before the bytes go out, while nobody else can write; it raises to keep them back.

        Raises
        ------
        LinkLost
            If the port is gone.
        """
        with self._write_lock:
            if permit is not None:
                permit()
            if self._lost is None:
                try:
                    self._channel.send(command.encode("ascii") + END)
                    return
                except CHANNEL_ERRORS as error:
                    self._lost = str(error)
        raise self._link_lost(command)

    def ask(self, question: str, read: Callable[[str], T]) -> T:
        """Ask and return the answer; asked once more if none came, or one that `read` does not understand.

        Parameters
        ----------
        question : str
        read : callable
            Turns a line into a value; `ValueError` if it cannot be the answer.

        Raises
        ------
        DeviceTimeout, LinkLost
        """
        failures = 0
        while True:
            try:
                with self._turn.ordinary():
                    return self._answer(question, read, self._turn.wake)
            except OvertakenError:
                continue
            except DeviceTimeout:
                failures += 1
                if failures == ATTEMPTS:
                    raise

    def ask_first(self, question: str, read: Callable[[str], T]) -> T:
        """Ask ahead of everybody who waits, and prove that the answer belongs to this question.

        Raises
        ------
        DeviceTimeout, LinkLost
        """
        with self._turn.urgent():
            answer = self._answer(question, read, None)
            # a late answer in place of this one would leave this one in place of the version
            self._answer("VE?", self._same_version, None)
            return answer

    def close(self) -> None:
        """Release the port; harmless when repeated."""
        with self._turn.urgent():
            self._lost = self._lost or "the port was closed"
            self._channel.close()
        self._turn.close()

    def _answer(self, question: str, read: Callable[[str], T], wake: int | None) -> T:
        if self._lost is not None:
            raise self._link_lost(question)
        suspect, self._suspect = self._suspect, True
        try:
            if suspect:
                self._resynchronise(wake)
            self._buffer = b""
            self._channel.drain()
            self.send(question)
            line = self._line(question, wake, self._clock.now_s() + self._reply_timeout_s)
        except CHANNEL_ERRORS as error:
            self._lost = self._lost or str(error)
            raise self._link_lost(question) from error
        try:
            answer = read(line)
        except ValueError as error:
            raise self._timeout(question, str(error)) from None
        self._suspect = False
        return answer

    def _resynchronise(self, wake: int | None) -> None:
        """Ask for the version and throw away whatever comes before it."""
        self.send("VE?")
        deadline_s = self._clock.now_s() + self._reply_timeout_s
        while True:
            line = self._line("VE?", wake, deadline_s)
            if MODEL.fullmatch(line) and self.version in ("", line):
                self.version = line
                return

    def _same_version(self, line: str) -> str:
        if line != self.version:
            raise ValueError(f"{line!r} instead of {self.version!r}")
        return line

    def _line(self, question: str, wake: int | None, deadline_s: float) -> str:
        """Wait for a whole line."""
        while b"\n" not in self._buffer:
            if not (data := self._channel.receive(deadline_s, wake)):
                got = f"the part {self._buffer!r}" if self._buffer else "silence"
                raise self._timeout(question, got)
            self._buffer += data
        line, _, self._buffer = self._buffer.partition(b"\n")
        return line.decode("ascii", "backslashreplace").strip()

    def _timeout(self, question: str, got: str) -> DeviceTimeout:
        return DeviceTimeout(
            self.name,
            f"ask {question!r}",
            expected=f"an answer within {self._reply_timeout_s:g} s",
            got=got,
            remedy="check power, cable, baud rate and axis",
        )

    def _link_lost(self, command: str) -> LinkLost:
        return LinkLost(
            self.name,
            f"send {command!r}",
            expected="an open port",
            got=self._lost or "the port closed",
            remedy="check the cable, then open the stage again and home it",
        )
