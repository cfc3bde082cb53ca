"""Messages between a run and its guardian, over two pipes.

The run sends single bytes. The guardian answers with lines: a word, and for most words a JSON value.
"""

import json
import os
import select
from typing import Any

from drivers.clock import SystemClock

MOVING = b"m"
"""Message of the run: something may be moving. Either all devices were read, or a motion command follows."""
STANDING = b"s"
"""Message of the run: all devices were read, and everything stands still."""
WAITING = b"w"
"""Message of the run: everything stands still, a person is asked, and the next reading may take long."""
PING = b"p"
"""Question of the run whether the guardian is alive. The question does not count as a sign of progress."""
DONE = b"d"
"""Message of the run: the run has ended in a safe state."""

READY, REFUSED, ALIVE, LOST, STOPPED = "ready", "refused", "alive", "lost", "stopped"
"""Messages of the guardian. The main loop, which does the guardian's work, says `ALIVE` itself. The value is
null while it watches, and while it stops machines, the age in s of the present attempt for each of them."""

CHUNK = 4096


def line(word: str, value: Any = None) -> bytes:
    """Return one message of the guardian, as the bytes of a line."""
    return f"{word} {json.dumps(value)}\n".encode()


class Lines:
    """The lines that arrive on a descriptor."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._buffer = b""
        self._clock = SystemClock()

    def next(self, timeout_s: float) -> tuple[str, Any] | None:
        """Return the word and the value of the next line, or None if no line comes in time.

        Raise `EOFError` if the other process has closed the pipe.
        """
        deadline_s = self._clock.now_s() + timeout_s
        waiting = select.poll()
        waiting.register(self._descriptor, select.POLLIN)
        while b"\n" not in self._buffer:
            left_s = max(0.0, deadline_s - self._clock.now_s())
            if not waiting.poll(left_s * 1000):
                return None
            if not (data := os.read(self._descriptor, CHUNK)):
                raise EOFError
            self._buffer += data
        text, _, self._buffer = self._buffer.partition(b"\n")
        word, _, value = text.decode().partition(" ")
        return word, json.loads(value)
