"""Base class of the ports of all stages: sends one message at a time on a channel."""

import threading
from abc import ABC, abstractmethod
from collections.abc import Callable

from drivers.errors import DeviceTimeout, LinkLost
from drivers.lines.call_time import CallTime
from drivers.lines.channel import CHANNEL_ERRORS, Channel


class StagePort(ABC):
    """An exclusive port. No other program can use it, and any thread may send messages.

    `channel` is the open channel to the device. The port closes it. `reply_timeout_s` is the longest wait for
    a complete answer, in seconds of real time. `call_time` is the time left in the present call of the
    driver.
    """

    def __init__(self, name: str, channel: Channel, reply_timeout_s: float) -> None:
        self.name = name
        self._reply_timeout_s = reply_timeout_s
        self._write_lock = threading.Lock()
        self._lost: str | None = None
        self._channel = channel
        self.call_time = CallTime()

    @abstractmethod
    def close(self) -> None:
        """Release the port. A repeated call has no effect."""

    def _write(self, message: bytes, command: str, permit: Callable[[], None] | None) -> None:
        """Call `permit`, then send a message. If `permit` raises an exception, nothing is sent.

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
            f"an answer within {timeout_s:.3g} s",
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
