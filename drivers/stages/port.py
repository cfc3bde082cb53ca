"""Base of all stage ports: an exclusive channel, one message at a time, and errors."""

import threading
from abc import ABC, abstractmethod
from collections.abc import Callable

from drivers.errors import DeviceTimeout, LinkLost
from drivers.lines.channel import CHANNEL_ERRORS, open_device


class StagePort(ABC):
    """An exclusively opened port; messages may be sent from any thread.

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
        self._write_lock = threading.Lock()
        self._lost: str | None = None
        self._channel = open_device(name, url, baud, reply_timeout_s)

    @abstractmethod
    def close(self) -> None:
        """Release the port; harmless when repeated."""

    def _write(self, message: bytes, command: str, permit: Callable[[], None] | None) -> None:
        """Send a message; call `permit` just before, while no other thread can write; it may raise.

        The caller holds the write lock.
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
