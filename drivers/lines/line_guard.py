"""The guard of a device with text commands: owns the line, passes the driver's messages on, and can stop.

A driver of a stage or a load frame on a serial port needs a `LineTalk` and a call of `guard_spec`. A guardian
process then stops the device if the program dies or hangs.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from drivers.interfaces import OpenContext
from drivers.lines.addresses import shared_line
from drivers.lines.channel import CHANNEL_ERRORS, Channel, cannot_open, open_channel
from drivers.lines.device_port import DevicePort
from drivers.lines.relay import Relay, whole_lines
from drivers.lines.stop_deadline import STOP_TIMES, stop_until_confirmed
from drivers.registry import GuardSpec

P = TypeVar("P", bound=DevicePort)


@dataclass(frozen=True)
class LineTalk(Generic[P]):
    """Functions and settings with which a guard sends messages to a device.

    Attributes
    ----------
    address : str
        Path of the serial port, or ``socket://host:port``.
    baud : int
    ends : bytes
        The bytes that can end a message to the device. Each byte alone ends a message.
    open_port : callable
        ``open_port(name, channel, reply_timeout_s)`` returns a port on an open channel.
    stop : callable
        ``stop(port, answer_s)`` commands a stop once. The function returns an empty text if the device stands
        still, otherwise the reason why this is not certain.
    identity : callable
        ``identity(port, answer_s)`` returns a text that identifies the device, such as its serial number.
    reply_timeout_s : float
        Longest wait for an answer. The guard waits for 1 s at most.
    """

    address: str
    baud: int
    ends: bytes
    open_port: Callable[[str, Channel, float], P]
    stop: Callable[[P, float], str]
    identity: Callable[[P, float], str]
    reply_timeout_s: float = STOP_TIMES.answer_s


class LineGuard(Generic[P]):
    """A `Guard` that owns the line to a device. The constructor connects to the device.

    Raise `DeviceError` if the line cannot be opened, or the device does not answer.
    """

    def __init__(self, talk: LineTalk[P], context: OpenContext) -> None:
        self._name = f"{context.name} ({talk.address})"
        self._clock = context.clock
        self._talk = talk
        self._answer_s = min(talk.reply_timeout_s, STOP_TIMES.answer_s)
        self._line = Relay(
            lambda: open_channel(talk.address, talk.baud, STOP_TIMES.answer_s), whole_lines(talk.ends)
        )
        self._port: P | None = None
        # False after the line was lost, because another device may now be connected to it
        self._proven = True
        try:
            self._identity = talk.identity(self._opened(), self._answer_s)
            self._release_port()
            self._line.begin()
        except BaseException:
            self.close()
            raise
        self.relay = self._line.address

    def check(self) -> None:
        """Do nothing, because the driver's messages on the same line already show that the line works."""

    def stop(self) -> None:
        """Take over the line and stop the device. Raise `DeviceTimeout` if the device does not report
        standstill."""
        self._line.take_over()
        self._proven = True
        stop_until_confirmed(self._name, self._stop_once, self._clock, on_lost=self._drop)

    def _stop_once(self) -> str:
        port = self._opened()
        return self._talk.stop(port, self._answer_s) or self._stranger(port)

    def _stranger(self, port: P) -> str:
        """Return an empty text if the expected device answers, otherwise the identity of the other device."""
        found = self._identity if self._proven else self._talk.identity(port, self._answer_s)
        return "" if found == self._identity else f"the device {found}"

    def _drop(self) -> None:
        self._proven = False
        self._release_port()
        self._line.drop_channel()

    def close(self) -> None:
        """Release the line without stopping the device. A repeated call has no effect."""
        self._release_port()
        self._line.close()

    def _opened(self) -> P:
        if self._port is None:
            try:
                channel = self._line.channel()
            except CHANNEL_ERRORS as error:
                raise cannot_open(
                    self._name, "open port for the guardian", self._talk.address, error
                ) from error
            self._port = self._talk.open_port(self._name, channel, self._answer_s)
        return self._port

    def _release_port(self) -> None:
        port, self._port = self._port, None
        if port is not None:
            port.close()


def guard_spec(talk: Callable[[Any], LineTalk[P]]) -> GuardSpec:
    """Return the `GuardSpec` with which a guardian process guards the devices of a driver.

    ``talk(settings)`` returns the `LineTalk` for a device with these settings.
    """
    return GuardSpec(
        line=lambda settings: shared_line(talk(settings).address),
        open=lambda settings, context: LineGuard(talk(settings), context),
    )
