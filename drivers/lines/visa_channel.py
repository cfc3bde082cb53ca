"""Send and receive messages through VISA, the interface of measuring instruments (GPIB, USBTMC, LXI, serial).

The package PyVISA of the extra `visa` is imported only when a channel is opened.
"""

import contextlib
from dataclasses import dataclass
from typing import Any

from drivers.clock import SystemClock
from drivers.lines.channel import DRAIN_CHUNKS, Channel

_AT_ONCE_MS = 1
_STREAMS = ("SOCKET", "ASRL")
"""Parts of the names of resources that transmit bytes and no messages."""


@dataclass(frozen=True)
class VisaSerial:
    """Settings of a serial port that VISA opens."""

    baud: int
    data_bits: int
    parity: str
    stop_bits: int


class VisaChannel(Channel):
    """A VISA resource. Only one thread at a time may use it, and another thread cannot end a wait.

    Parameters
    ----------
    resource : str
        The name of the resource, such as ``TCPIP0::192.168.0.5::INSTR``.
    library : str
        The library as PyVISA names it, such as ``@py``.
    end : bytes
        The last byte of a message of the instrument.
    serial : VisaSerial
        Settings of the resource if it is a serial port.
    timeout_s : float
        Longest wait for the opening and for sending.

    Raises
    ------
    ImportError
        If PyVISA is not installed.
    OSError
        If the library or the resource cannot be opened.
    """

    def __init__(self, resource: str, library: str, end: bytes, serial: VisaSerial, timeout_s: float) -> None:
        import pyvisa

        self._timed_out = pyvisa.constants.StatusCode.error_timeout
        self._clock = SystemClock()
        self._timeout_ms = round(1000 * timeout_s)
        self._sends_bytes = any(part in resource for part in _STREAMS)
        # a message-based instrument forgets its unread answers when it is cleared
        self.is_cleared_by_discard = not self._sends_bytes
        # libraries by several makers raise exceptions of many kinds
        try:
            manager: Any = pyvisa.ResourceManager(library)
            self._resource = manager.open_resource(resource, open_timeout=self._timeout_ms)
        except Exception as error:
            raise OSError(f"{type(error).__name__}: {error}") from error
        if not isinstance(self._resource, pyvisa.resources.MessageBasedResource):
            self.close()
            raise OSError(f"{resource!r}, which takes no messages")
        try:
            if self._sends_bytes:
                self._resource.read_termination = end.decode("ascii")
            if "ASRL" in resource:
                self._set_up(serial)
        except Exception as error:
            self.close()
            raise OSError(f"{type(error).__name__}: {error}") from error

    def _set_up(self, serial: VisaSerial) -> None:
        from pyvisa.constants import Parity, StopBits

        self._resource.baud_rate = serial.baud
        self._resource.data_bits = serial.data_bits
        self._resource.parity = {"N": Parity.none, "E": Parity.even, "O": Parity.odd}[serial.parity]
        self._resource.stop_bits = StopBits.one if serial.stop_bits == 1 else StopBits.two

    def fileno(self) -> int:
        """Raise `OSError`, because a VISA resource has no file descriptor."""
        raise OSError("a VISA resource has no file descriptor")

    def send(self, data: bytes) -> None:
        """Send one message."""
        try:
            self._resource.timeout = self._timeout_ms
            self._resource.write_raw(data)
        except Exception as error:
            raise _lost(error) from error

    def receive(self, deadline_s: float, wake: int | None = None) -> bytes:
        """Wait for a message, and return it and what came with it. Return no bytes at the deadline.

        `deadline_s` is the end of the wait, in seconds on the system's clock. `wake` is not used.
        """
        data = self._message(max(_AT_ONCE_MS, round(1000 * (deadline_s - self._clock.now_s()))))
        if data and self._sends_bytes:
            data += self._rest()
        return data

    def drain(self) -> None:
        """Discard all received bytes. A message-based instrument is not asked for messages that it may not
        have, because it would count this as an error."""
        if self._sends_bytes:
            self._rest()

    def discard(self) -> None:
        """Clear the instrument, which then forgets all unread answers.

        If it cannot be cleared, `is_cleared_by_discard` becomes False.
        """
        if not self.is_cleared_by_discard:
            self.drain()
            return
        import pyvisa

        try:
            self._resource.clear()
        except (NotImplementedError, pyvisa.errors.VisaIOError):
            self.is_cleared_by_discard = False
        except Exception as error:
            raise _lost(error) from error

    def close(self) -> None:
        """Close the resource. A repeated call has no effect."""
        with contextlib.suppress(Exception):
            self._resource.close()

    def _rest(self) -> bytes:
        received = b""
        for _ in range(DRAIN_CHUNKS):
            if not (more := self._message(_AT_ONCE_MS)):
                return received
            received += more
        raise ConnectionAbortedError("the other end never stops sending")

    def _message(self, timeout_ms: int) -> bytes:
        try:
            self._resource.timeout = timeout_ms
            data: bytes = self._resource.read_raw()
        except Exception as error:
            if getattr(error, "error_code", None) == self._timed_out:
                return b""
            raise _lost(error) from error
        return data if not data or data.endswith((b"\r", b"\n")) else data + b"\n"


def _lost(error: Exception) -> OSError:
    return error if isinstance(error, OSError) else OSError(f"{type(error).__name__}: {error}")
