"""A serial port with a Zaber ASCII device behind it: requests out, each answer to whoever asked for it.

One thread reads the port and hands every answer over by its id. So a stop never waits for another request's
answer: only the writing of a message, a few bytes, is done one at a time.
"""

import queue
import re
import threading
from collections.abc import Callable

from drivers.channel import CHANNEL_ERRORS, open_channel
from drivers.clock import SystemClock
from drivers.errors import DeviceTimeout, LinkLost
from drivers.zaber_protocol import IDS, DamagedLineError, Reply, decode, encode

BAUD = 115_200
READ_WAIT_S = 0.05
LINE_MAX = 512

Answer = Reply | DamagedLineError | None


class ZaberPort:
    """An exclusively opened port; `ask` may be called from any thread.

    Parameters
    ----------
    name : str
        The device's name and port, for messages.
    url : str
        A serial device's path, or ``socket://host:port``.
    reply_timeout_s : float
        Deadline for a complete answer, in real time.

    Raises
    ------
    LinkLost
        If the port cannot be opened.
    """

    def __init__(self, name: str, url: str, reply_timeout_s: float) -> None:
        self.name = name
        self._reply_timeout_s = reply_timeout_s
        self._write_lock = threading.Lock()
        self._waiting: dict[int, queue.SimpleQueue[Answer]] = {}
        self._next_id = 0
        self._lost: str | None = None
        self._closing = False
        try:
            self._channel = open_channel(url, BAUD, reply_timeout_s)
        except CHANNEL_ERRORS as error:
            raise LinkLost(
                name,
                "open port",
                expected="a free serial port",
                got=str(error),
                remedy="check path and cable, and that no other program holds the port",
            ) from error
        self._reader = threading.Thread(target=self._read, name=f"read {url}", daemon=True)
        self._reader.start()

    def ask(
        self, address: int, axis: int, command: str, *, permit: Callable[[], None] | None = None
    ) -> Reply:
        """Send one command and return its answer.

        Parameters
        ----------
        address, axis : int
        command : str
            Empty to ask for the status.
        permit : callable, optional
            Called just before the bytes go out, while nobody else can write; it raises to keep them back.

        Raises
        ------
        DeviceTimeout
            If no whole answer came in time. The device may have acted on the command all the same.
        LinkLost
            If the port is gone.
        """
        answers: queue.SimpleQueue[Answer] = queue.SimpleQueue()
        with self._write_lock:
            if permit is not None:
                permit()
            id = self._next_id = next(i for i in _after(self._next_id) if i not in self._waiting)
            self._waiting[id] = answers
            try:
                self._write(encode(address, axis, id, command), command)
            except BaseException:
                del self._waiting[id]
                raise
        try:
            answer = answers.get(timeout=self._reply_timeout_s)
        except queue.Empty:
            raise self._timeout(command, "silence") from None
        finally:
            del self._waiting[id]
        if answer is None:
            raise self._link_lost(command)
        if isinstance(answer, DamagedLineError):
            raise self._timeout(command, f"the damaged line {str(answer)!r}")
        return answer

    def _write(self, message: bytes, command: str) -> None:
        if self._lost is None:
            try:
                self._channel.send(message)
                return
            except CHANNEL_ERRORS as error:
                self._lost = str(error)
        raise self._link_lost(command)

    def _read(self) -> None:
        buffer, clock = b"", SystemClock()
        while not self._closing:
            try:
                buffer += self._channel.receive(clock.now_s() + READ_WAIT_S)
            except CHANNEL_ERRORS as error:
                self._lost = self._lost or str(error)
                self._tell_all(None)
                return
            *lines, rest = re.split(rb"[\r\n]+", buffer)
            buffer = rest[-LINE_MAX:]
            for line in filter(None, lines):
                self._hand_over(line)

    def _hand_over(self, line: bytes) -> None:
        try:
            reply = decode(line)
        except DamagedLineError as damage:
            # its id cannot be trusted either: it may have been the answer to anybody who waits
            self._tell_all(damage)
            return
        if reply is not None and (answers := self._waiting.get(reply.id)) is not None:
            answers.put(reply)

    def _tell_all(self, answer: Answer) -> None:
        for answers in list(self._waiting.values()):
            answers.put(answer)

    def _timeout(self, command: str, got: str) -> DeviceTimeout:
        return DeviceTimeout(
            self.name,
            f"send {command or 'status request'!r}",
            expected=f"an answer within {self._reply_timeout_s:g} s",
            got=got,
            remedy="check power, cable, baud rate and device address",
        )

    def _link_lost(self, command: str) -> LinkLost:
        return LinkLost(
            self.name,
            f"send {command or 'status request'!r}",
            expected="an open port",
            got=self._lost or "the port closed",
            remedy="check the cable, then open the stage again and home it",
        )

    def close(self) -> None:
        """Release the port; harmless when repeated."""
        self._closing = True
        self._reader.join()
        self._lost = self._lost or "the port was closed"
        self._channel.close()


def _after(id: int) -> list[int]:
    """All ids, from the one after `id` on: a late answer meets its id again only after a hundred requests."""
    return [*IDS[id + 1 :], *IDS[: id + 1]]
