"""Base class of the ports of devices with a message protocol: sends one message at a time on a channel."""

import threading
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import ClassVar

from drivers.errors import DeviceTimeout, LinkLost
from drivers.lines.call_time import CallTime
from drivers.lines.channel import CHANNEL_ERRORS, Channel


class DevicePort(ABC):
    """An exclusive port. No other program can use it, and any thread may send messages.

    `channel` is the open channel to the device. The port closes it. `reply_timeout_s` is the longest wait for
    a complete answer, in seconds of real time. `call_time` is the time left in the present call of the
    driver.
    """

    silence_remedy: ClassVar[str] = "check power, cable and baud rate"
    lost_remedy: ClassVar[str] = "check the cable, then open the device again"

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
        expected = f"an answer within {timeout_s:.3g} s"
        return DeviceTimeout(self.name, f"send {command!r}", expected, got, self.silence_remedy)

    def _link_lost(self, command: str) -> LinkLost:
        got = self._lost or "the port closed"
        return LinkLost(self.name, f"send {command!r}", "an open port", got, self.lost_remedy)
