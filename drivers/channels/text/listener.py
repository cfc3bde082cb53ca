"""Collect the lines that an instrument sends by itself, each with the time at which it arrived."""

import threading
from collections import deque
from dataclasses import dataclass

from drivers.clock import Clock, SystemClock
from drivers.lines.channel import CHANNEL_ERRORS, Channel

BACKLOG = 100_000
"""Largest number of lines that wait to be read. Older lines are lost, and counted."""
LINE_MAX = 512
_POLL_S = 0.05


@dataclass(frozen=True)
class ArrivedLine:
    """A line, and the time of its arrival on the rig's clock in s.

    `may_be_cut` is True for the first line, whose beginning may be missing. `lost` is the number of lines
    that were lost just before.
    """

    text: str
    arrived_s: float
    may_be_cut: bool
    lost: int


class Listener:
    """A thread that reads lines from a channel. It closes the channel at the end.

    `ready_s` is the time on the rig's clock before which lines are discarded.
    """

    def __init__(self, name: str, channel: Channel, encoding: str, clock: Clock, ready_s: float) -> None:
        self._channel, self._encoding, self._clock = channel, encoding, clock
        self._ready_s = ready_s
        self._changed = threading.Condition()
        self._lines: deque[ArrivedLine] = deque()
        self._lost = 0
        self._closing = False
        self.error = ""
        self._thread = threading.Thread(target=self._listen, name=f"listen to {name}", daemon=True)
        self._thread.start()

    def send(self, message: bytes) -> None:
        """Send a message. Raise one of `CHANNEL_ERRORS` if the connection is lost."""
        self._channel.send(message)

    def take(self, count: int, timeout_s: float) -> list[ArrivedLine]:
        """Return at most `count` lines. Wait up to `timeout_s` of real time if there is none."""
        with self._changed:
            self._changed.wait_for(lambda: self._lines or self.error, timeout_s)
            return [self._lines.popleft() for _ in range(min(count, len(self._lines)))]

    def close(self) -> None:
        """End the thread and close the channel. A repeated call has no effect."""
        self._closing = True
        self._thread.join()
        self._channel.close()
        with self._changed:
            self.error = self.error or "the port was closed"
            self._changed.notify_all()

    def _listen(self) -> None:
        buffer, real, is_first = b"", SystemClock(), True
        while not self._closing:
            try:
                received = self._channel.receive(real.now_s() + _POLL_S)
            except CHANNEL_ERRORS as error:
                with self._changed:
                    self.error = str(error)
                    self._changed.notify_all()
                return
            arrived_s = self._clock.now_s()
            *lines, buffer = (buffer + received).replace(b"\r", b"\n").split(b"\n")
            buffer = buffer[-LINE_MAX:]
            for line in filter(None, map(bytes.strip, lines)):
                if arrived_s >= self._ready_s:
                    self._put(line.decode(self._encoding, "backslashreplace"), arrived_s, is_first)
                    is_first = False

    def _put(self, text: str, arrived_s: float, may_be_cut: bool) -> None:
        with self._changed:
            if len(self._lines) >= BACKLOG:
                self._lost += 1 + self._lines.popleft().lost
            lost, self._lost = self._lost, 0
            self._lines.append(ArrivedLine(text, arrived_s, may_be_cut, lost))
            self._changed.notify_all()
