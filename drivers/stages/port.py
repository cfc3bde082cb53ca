"""Base class of the ports of all stages: opens the connection, and sends one message at a time."""

import threading
from abc import ABC, abstractmethod
from collections.abc import Callable

from drivers.errors import DeviceTimeout, LinkLost
from drivers.lines.channel import CHANNEL_ERRORS, Channel, open_device


class StagePort(ABC):
    """A port that only this program may open; any thread may send messages.

    Parameters
    ----------
    name : str
        The device's name and port, used in error messages.
    url : str
        Path of a serial port, or ``socket://host:port``.
    baud : int
    reply_timeout_s : float
        Longest wait for a complete answer, in seconds of real time.
    relay : str
        Address ``host:port`` of a guardian's relay to the device; empty without a relay.
    channel : Channel, optional
        An open channel, which the port uses instead of opening `url`.

    Raises
    ------
    LinkLost
        If the port cannot be opened.
    """

    def __init__(
        self,
        name: str,
        url: str,
        baud: int,
        reply_timeout_s: float,
        relay: str = "",
        channel: Channel | None = None,
    ) -> None:
        self.name = name
        self._reply_timeout_s = reply_timeout_s
        self._write_lock = threading.Lock()
        self._lost: str | None = None
        self._channel = channel or open_device(name, url, baud, reply_timeout_s, relay)

    @abstractmethod
    def close(self) -> None:
        """Release the port; a repeated call has no effect."""

    def _write(self, message: bytes, command: str, permit: Callable[[], None] | None) -> None:
        """Call `permit`, then send a message; if `permit` raises, nothing is sent.

        The caller must hold the write lock, so that no other thread writes in between.
        """
        if permit is not None:
            permit()
        if self._lost is None:
            try:
                self._channel.send(message)
                return
            except CHANNEL_ERRORS as error:
                self._lost = str(error)
        raise self._link_lost(command)

    def _timeout(self, command: str, timeout_s: float, got: str) -> DeviceTimeout:
        return DeviceTimeout(
            self.name,
            f"send {command!r}",
            f"an answer within {timeout_s:g} s",
            got,
            "check power, cable, baud rate, device address and axis",
        )

    def _link_lost(self, command: str) -> LinkLost:
        return LinkLost(
            self.name,
            f"send {command!r}",
            "an open port",
            self._lost or "the port closed",
            "check the cable, then open the stage again and home it",
        )
