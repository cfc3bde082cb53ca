"""A two-wire line whose adapter also receives what it sends, as RS-485 adapters do that suppress no echo."""

from drivers.lines.channel import Channel

ECHO_S = 0.1
"""Longest wait in s for an echo after the time of its transmission: buffers of adapters add 16 ms."""
_BITS_PER_CHARACTER = 11


class EchoedChannel(Channel):
    """A channel that takes the echo of every message out of the received bytes.

    `channel` is the line itself.
    """

    def __init__(self, channel: Channel, baud: int) -> None:
        super().__init__(channel)
        self._channel = channel
        self._baud = baud
        self._pending = b""

    def send(self, data: bytes) -> None:
        """Send all bytes of `data`, and wait for their echo. Raise `OSError` if it does not come."""
        self._channel.send(data)
        deadline_s = self._clock.now_s() + len(data) * _BITS_PER_CHARACTER / self._baud + ECHO_S
        while (place := self._pending.find(data)) < 0:
            if not (more := self._channel.receive(deadline_s)):
                raise OSError("no echo of the request, although `echo = true` announces one")
            self._pending += more
        # A late answer to an earlier request may be on the line before the echo.
        self._pending = self._pending[:place] + self._pending[place + len(data) :]

    def receive(self, deadline_s: float, wake: int | None = None) -> bytes:
        """Return all received bytes that are no echo. The errors are those of the line."""
        if self._pending:
            pending, self._pending = self._pending, b""
            return pending
        return self._channel.receive(deadline_s, wake)

    def discard(self) -> None:
        """Discard received bytes, and on a serial port also bytes that are not yet transmitted."""
        self._pending = b""
        self._channel.discard()

    def close(self) -> None:
        """Close the line. A repeated call has no effect."""
        self._channel.close()
