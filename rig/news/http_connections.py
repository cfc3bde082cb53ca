"""Bounds of the HTTP interface, so that no program of this computer can use up what the run itself needs.

Every connection takes a file descriptor of the run, which also needs some for its file, its cameras and its
heartbeat. A connection is closed if no whole request comes in time. If there are too many, the oldest gives
way, first among those that wait for a request. So an abort gets in, however many others are open.
"""

from typing import Any

from uvicorn.protocols.http.h11_impl import H11Protocol

CONNECTIONS_MAX = 64
REQUEST_S = 5.0
"""Longest time in s for a request to arrive as a whole."""
WAITING_MAX = 32
"""Number of connections that the system keeps for the server, which takes as many at once."""


class BoundedConnection(H11Protocol):
    """One connection to the interface."""

    request_s = REQUEST_S

    def connection_made(self, transport: Any) -> None:
        """Close the oldest connection if there are too many, and wait for a request."""
        others = [
            each
            for each in self.connections
            if isinstance(each, BoundedConnection) and not each.transport.is_closing()
        ]
        super().connection_made(transport)
        self._since_s = self._asked_s = self.loop.time()
        if len(others) >= CONNECTIONS_MAX:
            min(others, key=lambda each: (not each.waits, each.since_s)).transport.abort()
        self._timer = self.loop.call_later(self.request_s, self._close_if_late)

    def data_received(self, data: bytes) -> None:
        """Take a part of a request. When it is whole, the time for the next one begins."""
        before = self.cycle
        super().data_received(data)
        if self.cycle is not before:
            self._asked_s = self.loop.time()

    def connection_lost(self, exc: Exception | None) -> None:
        """Stop waiting."""
        self._timer.cancel()
        super().connection_lost(exc)

    @property
    def waits(self) -> bool:
        """True if no whole request is being answered."""
        cycle: Any = self.cycle
        return cycle is None or cycle.response_complete or cycle.more_body

    @property
    def since_s(self) -> float:
        """Time at which the connection was made, on the loop's clock."""
        return self._since_s

    def _close_if_late(self) -> None:
        now_s = self.loop.time()
        if not self.waits:
            self._asked_s = now_s
        elif now_s >= self._asked_s + self.request_s:
            self.transport.abort()
            return
        self._timer = self.loop.call_later(self.request_s / 4, self._close_if_late)
