"""Messages between the processes of the live measurement, over pipes that hold up neither side."""

import os
import pickle
import select
import struct
from collections import deque
from typing import Any

from drivers.clock import SystemClock

_LENGTH = struct.Struct("<Q")
_CHUNK = 1 << 20
_MOST_WAITING = 2000
"""Messages that wait for a reader; of more, the oldest are dropped."""


class Outbox:
    """Sends messages without waiting. Messages to a reader that does not read wait here; the oldest are lost.

    Parameters
    ----------
    descriptor : int
        The end of a pipe to write to.
    """

    def __init__(self, descriptor: int) -> None:
        os.set_blocking(descriptor, False)
        self._descriptor = descriptor
        self._begun = memoryview(b"")
        self._waiting: deque[bytes] = deque(maxlen=_MOST_WAITING)

    def put(self, message: Any) -> None:
        """Send a message, or let it wait. Raise `OSError` if the reader has ended."""
        self._waiting.append(_packed(message))
        self.flush()

    def flush(self) -> bool:
        """Send what waits; return True if nothing is left. Raise `OSError` if the reader has ended."""
        try:
            while self._begun or self._waiting:
                if not self._begun:
                    self._begun = memoryview(self._waiting.popleft())
                self._begun = self._begun[os.write(self._descriptor, self._begun[:_CHUNK]) :]
        except BlockingIOError:
            return False
        return True

    def send(self, message: Any, within_s: float) -> bool:
        """Send a message and wait until it is on its way; return False if that takes too long."""
        self.put(message)
        clock = SystemClock()
        end_s = clock.now_s() + within_s
        while not self.flush():
            left_s = end_s - clock.now_s()
            if left_s <= 0.0:
                return False
            _wait(self._descriptor, select.POLLOUT, left_s)
        return True


class Inbox:
    """Receives messages without waiting.

    Parameters
    ----------
    descriptor : int
        The end of a pipe to read from.
    """

    def __init__(self, descriptor: int) -> None:
        os.set_blocking(descriptor, False)
        self.descriptor = descriptor
        self.is_closed = False
        """True after the other side has closed the pipe."""
        self._received = bytearray()

    def take(self) -> list[Any]:
        """Return the messages that have come, the oldest first."""
        while not self.is_closed:
            try:
                chunk = os.read(self.descriptor, _CHUNK)
            except BlockingIOError:
                break
            except OSError:
                chunk = b""
            self.is_closed = not chunk
            self._received += chunk
        found = []
        begin = 0
        while len(self._received) - begin >= _LENGTH.size:
            (length,) = _LENGTH.unpack_from(self._received, begin)
            end = begin + _LENGTH.size + length
            if end > len(self._received):
                break
            found.append(pickle.loads(memoryview(self._received)[begin + _LENGTH.size : end]))
            begin = end
        del self._received[:begin]
        return found

    def wait_readable(self, within_s: float) -> None:
        """Wait until something can be received, or the other side has closed the pipe."""
        _wait(self.descriptor, select.POLLIN, within_s)

    def wait(self, within_s: float) -> list[Any]:
        """Wait for messages; return none after a time, or if the other side has closed the pipe."""
        clock = SystemClock()
        end_s = clock.now_s() + within_s
        while not (found := self.take()) and not self.is_closed:
            left_s = end_s - clock.now_s()
            if left_s <= 0.0:
                break
            self.wait_readable(left_s)
        return found


def _wait(descriptor: int, event: int, left_s: float) -> None:
    waiting = select.poll()
    waiting.register(descriptor, event)
    waiting.poll(1000.0 * left_s)


def _packed(message: Any) -> bytes:
    content = pickle.dumps(message, protocol=5)
    return _LENGTH.pack(len(content)) + content
