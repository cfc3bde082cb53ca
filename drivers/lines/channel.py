"""Send and receive bytes over TCP or a serial port. Another thread can end a wait for bytes."""

import contextlib
import os
import select
import socket
import termios
from abc import ABC, abstractmethod
from pathlib import Path
from typing import Any, Protocol

from drivers.clock import SystemClock
from drivers.errors import LinkLost

CHUNK = 4096
# Largest number of chunks that are discarded. A device that sends more is assumed to send for ever.
DRAIN_CHUNKS = 256
# TCP tries to deliver unacknowledged data for this multiple of the send timeout, then drops them.
UNDELIVERED = 2
TCP_PREFIX = "socket://"
# termios.error is listed, because it is not a subclass of OSError as pyserial's SerialException is
CHANNEL_ERRORS = (OSError, termios.error)
# Linux's major device numbers of pseudo-terminals (source: Documentation/admin-guide/devices.txt).
PTY_MAJORS = range(136, 144)


class OvertakenError(Exception):
    """Raised in a thread that waits for bytes, if an urgent request of another thread ends the wait."""


class _Port(Protocol):
    def fileno(self) -> int: ...
    def close(self) -> None: ...


class Channel(ABC):
    """An open connection. Every method may raise one of `CHANNEL_ERRORS` if the connection is lost.

    `port` is the opened port. `close` closes it. `is_cleared_by_discard` is True if no answer to an earlier
    request can arrive after `discard`.
    """

    is_cleared_by_discard = False

    def __init__(self, port: _Port) -> None:
        self._port = port
        self._clock = SystemClock()

    def fileno(self) -> int:
        """Return the file descriptor of the port."""
        return self._port.fileno()

    @abstractmethod
    def send(self, data: bytes) -> None:
        """Pass all bytes of `data` to the operating system for sending."""

    def drain(self) -> None:
        """Discard all received bytes that the program has not read."""
        for _ in range(DRAIN_CHUNKS):
            if not self.receive(0.0):
                return
        raise ConnectionAbortedError("the other end never stops sending")

    def discard(self) -> None:
        """Discard received bytes and, on a serial port, also bytes that are not yet transmitted."""
        self.drain()

    def receive(self, deadline_s: float, wake: int | None = None) -> bytes:
        """Wait for bytes and return all received bytes. Return no bytes if the deadline passes first.

        `deadline_s` is the end of the wait, in seconds on the system's clock. `wake` is a file descriptor.
        The wait ends when this descriptor becomes readable. Raise `OvertakenError` if the descriptor `wake`
        ended the wait.
        """
        descriptor = self._port.fileno()
        waiting = select.poll()
        waiting.register(descriptor, select.POLLIN)
        if wake is not None:
            waiting.register(wake, select.POLLIN)
        left_s = max(0.0, deadline_s - self._clock.now_s())
        ready = [ready_descriptor for ready_descriptor, _ in waiting.poll(left_s * 1000)]
        if wake is not None and wake in ready:
            raise OvertakenError
        if not ready:
            return b""
        if not (data := os.read(descriptor, CHUNK)):
            raise ConnectionResetError("the other end closed the connection")
        return data

    def close(self) -> None:
        """Close the channel. A repeated call has no effect."""
        with contextlib.suppress(*CHANNEL_ERRORS):
            self._port.close()


class TcpChannel(Channel):
    """A TCP connection that transmits every message without delay (option ``TCP_NODELAY``).

    `timeout_s` is the time limit for connecting and for sending, in seconds.
    """

    def __init__(self, host: str, port: int, timeout_s: float) -> None:
        try:
            self._socket = socket.create_connection((host, port), timeout=timeout_s)
        except UnicodeError as error:
            raise OSError(f"{host!r} is not a host name") from error
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        # After this time TCP drops the connection and all undelivered data. Otherwise TCP could deliver an
        # old motion command when the cable is plugged in again, and the stage would move unexpectedly.
        unheard_ms = max(1, round(1000 * UNDELIVERED * timeout_s))
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, unheard_ms)
        super().__init__(self._socket)

    def send(self, data: bytes) -> None:
        """Pass all bytes of `data` to the operating system for sending."""
        self._socket.sendall(data)


class SerialChannel(Channel):
    """A serial port that no other program can open at the same time.

    `parity` is the parity: ``N`` (none), ``E`` (even) or ``O`` (odd). `timeout_s` is the time limit for
    sending, in seconds. `data_bits` is 7 or 8.
    """

    def __init__(
        self, path: str, baud: int, parity: str, stop_bits: int, timeout_s: float, data_bits: int = 8
    ) -> None:
        import serial

        try:
            is_pseudo = _is_pseudo_terminal(path)
            self._serial: Any = serial.Serial(
                path,
                baudrate=baud,
                bytesize=8 if is_pseudo else data_bits,
                parity=serial.PARITY_NONE if is_pseudo else parity,
                stopbits=stop_bits,
                timeout=0,
                exclusive=True,
            )
        except (ValueError, OverflowError, termios.error) as error:
            raise OSError(str(error)) from error
        self._timeout_s = timeout_s
        super().__init__(self._serial)

    def send(self, data: bytes) -> None:
        """Pass all bytes of `data` to the operating system for sending."""
        # Do not use pyserial's `write`, because on a busy computer it can report a timeout although the
        # message was sent.
        descriptor, deadline_s = self._port.fileno(), self._clock.now_s() + self._timeout_s
        room = select.poll()
        room.register(descriptor, select.POLLOUT)
        while True:
            with contextlib.suppress(BlockingIOError):
                data = data[os.write(descriptor, data) :]
            if not data:
                return
            left_s = deadline_s - self._clock.now_s()
            if left_s <= 0 or not room.poll(left_s * 1000):
                raise TimeoutError(f"a port that accepts no bytes for {self._timeout_s:g} s")

    def discard(self) -> None:
        """Discard received bytes, and bytes that are not yet transmitted."""
        self._serial.reset_output_buffer()
        self.drain()


def open_channel(url: str, baud: int, timeout_s: float) -> Channel:
    """Open a serial port by its path, or a TCP connection by ``socket://host:port``.

    Raise `OSError` or `termios.error` if the address is malformed or the channel cannot be opened.
    """
    if not url.startswith(TCP_PREFIX):
        return SerialChannel(url, baud, "N", 1, timeout_s)
    host, _, port = url.removeprefix(TCP_PREFIX).rpartition(":")
    if not (host and port.isascii() and port.isdecimal() and int(port) < 2**16):
        raise OSError(f"expected {TCP_PREFIX}host:port, got {url}")
    return TcpChannel(host, int(port), timeout_s)


def open_device(name: str, url: str, baud: int, timeout_s: float, relay: str = "") -> Channel:
    """Open the channel to a device. Raise `LinkLost` with the device's name if this fails.

    `url` is the path of a serial port, or ``socket://host:port``. `relay` is the address ``host:port`` of the
    guardian's relay if a guardian owns the line, otherwise an empty text. If no guardian answers at this
    address, the line itself is opened.
    """
    try:
        return open_relay(relay, timeout_s) or open_channel(url, baud, timeout_s)
    except CHANNEL_ERRORS as error:
        raise cannot_open(name, "open port", url, error) from error


def cannot_open(name: str, step: str, url: str, error: Exception) -> LinkLost:
    """Return the `LinkLost` for a channel that cannot be opened. `name` is the device's name and port."""
    expected = "a connection" if url.startswith(TCP_PREFIX) else "a free serial port"
    remedy = "check address and cable, and that no other program holds the port"
    return LinkLost(name, step, expected, str(error), remedy)


def open_relay(relay: str, timeout_s: float) -> Channel | None:
    """Connect to the relay of a guardian. Return None if there is no relay or no guardian answers."""
    host, _, port = relay.rpartition(":")
    if host:
        with contextlib.suppress(ConnectionRefusedError):
            return TcpChannel(host, int(port), timeout_s)
    return None


def _is_pseudo_terminal(path: str) -> bool:
    """Return whether a path is a pseudo-terminal, which has neither parity nor 7 bits: Linux refuses both."""
    return os.major(Path(path).stat().st_rdev) in PTY_MAJORS
