"""A line between a client and a device: it splits bytes into messages, answers, and applies faults."""

from collections.abc import Callable
from typing import Protocol

from simulators.wire.faults import FaultPanel

PIECES = 3
PAUSE_BETWEEN_PIECES_S = 0.002


class WireProtocol(Protocol):
    """The functions of a protocol that a `Line` needs."""

    faults: FaultPanel

    def cut(self, buffer: bytes) -> tuple[list[bytes], bytes]:
        """Return the complete messages in a buffer, and the remaining bytes."""

    def respond(self, message: bytes) -> bytes:
        """Execute one message and return the answer; empty for no answer."""

    def damaged(self, reply: bytes) -> bytes:
        """Return a damaged copy of the answer, as after noise on the line."""

    def readdressed(self, reply: bytes) -> bytes:
        """Return the answer with the address of another device."""


class Line:
    """The line between a device and one client: it collects messages, and applies faults to the answers.

    `send` sends bytes to the client. `pause` waits for a number of seconds in real time. Closing the line
    ends the wait.
    """

    def __init__(
        self, wire: WireProtocol, send: Callable[[bytes], object], pause: Callable[[float], object]
    ) -> None:
        self._wire = wire
        self._send = send
        self._pause = pause
        self._buffer = b""
        self._held = b""
        self._last = b""

    def receive(self, data: bytes) -> None:
        """Add bytes from the client to the buffer, and answer every complete message."""
        messages, self._buffer = self._wire.cut(self._buffer + data)
        for message in messages:
            self._serve(message)

    def _serve(self, message: bytes) -> None:
        held, self._held = self._held, b""
        reply = self._reply(message)
        if reply and self._wire.faults.take("late") is not None:
            self._held, reply = reply, b""
        if held + reply:
            self._give(held + reply)

    def _reply(self, message: bytes) -> bytes:
        """Return the answer after the faults are applied; empty for no answer."""
        faults = self._wire.faults
        if faults.take("lose-request") is not None:
            return b""
        reply = self._wire.respond(message)
        if not reply or faults.take("drop") is not None:
            return b""
        self._last, before = reply, self._last
        if faults.take("stale") is not None:
            reply = before
        if reply and faults.take("wrong-unit") is not None:
            reply = self._wire.readdressed(reply)
        if reply and faults.take("corrupt") is not None:
            reply = self._wire.damaged(reply)
        if (seconds := faults.take("delay")) is not None:
            self._pause(float(seconds))
        return reply * 2 if faults.take("duplicate") is not None else reply

    def _give(self, data: bytes) -> None:
        if self._wire.faults.take("split") is None:
            self._send(data)
            return
        size = -(-len(data) // PIECES)
        for start in range(0, len(data), size):
            if start:
                self._pause(PAUSE_BETWEEN_PIECES_S)
            self._send(data[start : start + size])
