"""Bytes to and from a device, over TCP or a serial port, with a wait that another thread can end."""

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
# No device leaves more chunks unread; a device that still sends after so many never stops.
DRAIN_CHUNKS = 256
# TCP may try to deliver data for this multiple of the send timeout.
UNDELIVERED = 2
TCP_PREFIX = "socket://"
# pyserial's SerialException is an OSError; termios.error is not an OSError
CHANNEL_ERRORS = (OSError, termios.error)
# Major numbers of pseudo-terminal slaves: Linux, Documentation/admin-guide/devices.txt.
PTY_MAJORS = range(136, 144)


class OvertakenError(Exception):
    """An urgent request ended the wait."""


class _Port(Protocol):
    def fileno(self) -> int: ...
    def close(self) -> None: ...


class Channel(ABC):
    """An open connection; every method may raise one of `CHANNEL_ERRORS` if the connection is lost.

    Parameters
    ----------
    port : socket or serial port
        The channel owns the port and closes it.
    """

    def __init__(self, port: _Port) -> None:
        self._port = port
        self._clock = SystemClock()

    @abstractmethod
    def send(self, data: bytes) -> None:
        """Hand all of `data` to the operating system."""

    def drain(self) -> None:
        """Discard the received bytes that were not read."""
        for _ in range(DRAIN_CHUNKS):
            if not self.receive(0.0):
                return
        raise ConnectionAbortedError("the other end sends without end")

    def discard(self) -> None:
        """Discard unread received bytes and, if the port allows it, bytes not yet transmitted."""
        self.drain()

    def receive(self, deadline_s: float, wake: int | None = None) -> bytes:
        """Return the received bytes, at least one; empty if the deadline passes first.

        Parameters
        ----------
        deadline_s : float
            On the system's clock.
        wake : int, optional
            A descriptor that ends the wait when it becomes readable.

        Raises
        ------
        OvertakenError
            If `wake` ended the wait.
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
        """Close the channel; harmless when repeated."""
        with contextlib.suppress(*CHANNEL_ERRORS):
            self._port.close()


class TcpChannel(Channel):
    """A TCP connection that transmits every message at once.

    Parameters
    ----------
    host : str
    port : int
    timeout_s : float
        For connecting, and for sending.
    """

    def __init__(self, host: str, port: int, timeout_s: float) -> None:
        try:
            self._socket = socket.create_connection((host, port), timeout=timeout_s)
        except UnicodeError as error:
            raise OSError(f"{host!r} is no host name") from error
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        # The connection is dropped with all undelivered data. Otherwise TCP would deliver an old motion
        # command when the cable is plugged in again, and a stage believed to stand would move.
        unheard_ms = max(1, round(1000 * UNDELIVERED * timeout_s))
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, unheard_ms)
        super().__init__(self._socket)

    def send(self, data: bytes) -> None:
        """Hand all of `data` to the operating system."""
        self._socket.sendall(data)


class SerialChannel(Channel):
    """A serial port, opened exclusively.

    Parameters
    ----------
    path : str
    baud : int
    parity : str
        ``N``, ``E`` or ``O``.
    stop_bits : int
    timeout_s : float
        For sending.
    """

    def __init__(self, path: str, baud: int, parity: str, stop_bits: int, timeout_s: float) -> None:
        import serial

        try:
            self._serial: Any = serial.Serial(
                path,
                baudrate=baud,
                parity=serial.PARITY_NONE if _is_pseudo_terminal(path) else parity,
                stopbits=stop_bits,
                timeout=0,
                exclusive=True,
            )
        except (ValueError, OverflowError, termios.error) as error:
            raise OSError(str(error)) from error
        self._timeout_s = timeout_s
        super().__init__(self._serial)

    def send(self, data: bytes) -> None:
        """Hand all of `data` to the operating system."""
        # pyserial's write can report a timeout for a sent message if this process waited for the processor
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
                raise TimeoutError(f"a port that takes no bytes for {self._timeout_s:g} s")

    def discard(self) -> None:
        """Discard unread received bytes and bytes not yet transmitted."""
        self._serial.reset_output_buffer()
        self.drain()


def open_channel(url: str, baud: int, timeout_s: float) -> Channel:
    """Open a serial port by its path, or a TCP connection by ``socket://host:port``.

    Raises
    ------
    OSError, termios.error
        If the address is malformed or the channel cannot be opened.
    """
    if not url.startswith(TCP_PREFIX):
        return SerialChannel(url, baud, "N", 1, timeout_s)
    host, _, port = url.removeprefix(TCP_PREFIX).rpartition(":")
    if not (host and port.isascii() and port.isdecimal() and int(port) < 2**16):
        raise OSError(f"expected {TCP_PREFIX}host:port, got {url}")
    return TcpChannel(host, int(port), timeout_s)


def open_device(name: str, url: str, baud: int, timeout_s: float) -> Channel:
    """Open the channel to a device; raise `LinkLost` with the device's name on failure."""
    try:
        return open_channel(url, baud, timeout_s)
    except CHANNEL_ERRORS as error:
        raise LinkLost(
            name,
            "open port",
            "a connection" if url.startswith(TCP_PREFIX) else "a free serial port",
            str(error),
            "check address and cable, and that no other program holds the port",
        ) from error


def _is_pseudo_terminal(path: str) -> bool:
    """Whether a path is a pseudo-terminal: Linux refuses to set its parity a second time."""
    return os.major(Path(path).stat().st_rdev) in PTY_MAJORS
