"""A line between a client and a device: it cuts messages from the stream, answers, and applies faults."""

from collections.abc import Callable
from typing import Protocol

from simulators.wire.faults import FaultPanel

PIECES = 3
PAUSE_BETWEEN_PIECES_S = 0.002


class Wire(Protocol):
    """How one protocol uses a stream of bytes."""

    faults: FaultPanel

    def cut(self, buffer: bytes) -> tuple[list[bytes], bytes]:
        """Return the complete messages in a buffer, and the rest to keep."""

    def respond(self, message: bytes) -> bytes:
        """Act on one message and return what is sent back, empty for nothing."""

    def damaged(self, reply: bytes) -> bytes:
        """Return the answer damaged, as by noise on the line."""

    def readdressed(self, reply: bytes) -> bytes:
        """Return the answer with the address of another device."""


class Line:
    """One client's line.

    Parameters
    ----------
    wire : Wire
    send : callable
        Takes bytes to the client.
    pause : callable
        Waits for a number of seconds of real time, shorter if the line is being closed.
    """

    def __init__(self, wire: Wire, send: Callable[[bytes], object], pause: Callable[[float], object]) -> None:
        self._wire = wire
        self._send = send
        self._pause = pause
        self._buffer = b""
        self._held = b""
        self._last = b""

    def receive(self, data: bytes) -> None:
        """Take in bytes from the client and answer every message that they complete."""
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
        """Return the bytes to send after faults were applied; empty for none."""
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
