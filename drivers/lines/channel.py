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
# More than any device leaves unread: one that still sends then never stops.
DRAIN_CHUNKS = 256
# For so many times the time for sending, TCP may try to deliver what was sent.
UNDELIVERED = 2
TCP_PREFIX = "socket://"
# pyserial's SerialException is an OSError, termios.error is none
CHANNEL_ERRORS = (OSError, termios.error)
# Linux, Documentation/admin-guide/devices.txt: the ends of pseudo-terminals that programs open.
PTY_MAJORS = range(136, 144)


class OvertakenError(Exception):
    """The wait was ended by something urgent."""


class _Port(Protocol):
    def fileno(self) -> int: ...
    def close(self) -> None: ...


class Channel(ABC):
    """An open connection; any of its calls may raise one of `CHANNEL_ERRORS` when it is gone.

    Parameters
    ----------
    port : socket or serial port
        Owned, and closed with the channel.
    """

    def __init__(self, port: _Port) -> None:
        self._port = port
        self._clock = SystemClock()

    @abstractmethod
    def send(self, data: bytes) -> None:
        """Hand all of `data` to the system."""

    def drain(self) -> None:
        """Forget what was received and not read."""
        for _ in range(DRAIN_CHUNKS):
            if not self.receive(0.0):
                return
        raise ConnectionAbortedError("the other end sends without end")

    def discard(self) -> None:
        """Forget what was received and not read, and what was sent and has not left yet, if it can be."""
        self.drain()

    def receive(self, deadline_s: float, wake: int | None = None) -> bytes:
        """Return what has come, at least a byte; nothing when the deadline passes first.

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
        """Close it; harmless when repeated."""
        with contextlib.suppress(*CHANNEL_ERRORS):
            self._port.close()


class TcpChannel(Channel):
    """A TCP connection; messages leave at once.

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
        # What cannot be delivered is dropped with the connection: a motion command that the system sent again
        # once the cable is back would move what everybody believes to be standing.
        unheard_ms = max(1, round(1000 * UNDELIVERED * timeout_s))
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, unheard_ms)
        super().__init__(self._socket)

    def send(self, data: bytes) -> None:
        """Hand all of `data` to the system."""
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
        """Hand all of `data` to the system."""
        # pyserial's own calls a message that has left unsent, if this program had to wait for the processor
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
        """Forget what was received and not read, and what was sent and has not left yet."""
        self._serial.reset_output_buffer()
        self.drain()


def open_channel(url: str, baud: int, timeout_s: float) -> Channel:
    """Open a serial port by its path, or a TCP connection by ``socket://host:port``.

    Raises
    ------
    OSError, termios.error
        If that fails, or the address is none.
    """
    if not url.startswith(TCP_PREFIX):
        return SerialChannel(url, baud, "N", 1, timeout_s)
    host, _, port = url.removeprefix(TCP_PREFIX).rpartition(":")
    if not (host and port.isascii() and port.isdecimal() and int(port) < 2**16):
        raise OSError(f"expected {TCP_PREFIX}host:port, got {url}")
    return TcpChannel(host, int(port), timeout_s)


def open_device(name: str, url: str, baud: int, timeout_s: float) -> Channel:
    """Open the channel to a device; `LinkLost`, with the device's name, if that fails."""
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
    """Whether there is no line behind it: it has no parity bit, and the system refuses to set one twice."""
    return os.major(Path(path).stat().st_rdev) in PTY_MAJORS
