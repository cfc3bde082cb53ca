"""Ports of simulated devices: pseudo-terminals and TCP ports, which can be unplugged and plugged in."""

import contextlib
import functools
import os
import re
import select
import shutil
import socket
import tempfile
import threading
import tty
from abc import ABC, abstractmethod
from pathlib import Path
from typing import ClassVar

from simulators.wire.line import Line, WireProtocol
from simulators.wire.tcp_server import TcpServer

LOCALHOST = "127.0.0.1"
PREFIX = "offaxis-pty-"
"""Prefix of the temporary folders that contain links to pseudo-terminals."""


@functools.cache
def _sweep() -> None:
    """Remove links to pseudo-terminals that killed processes left behind; later calls do nothing."""
    for folder in Path(tempfile.gettempdir()).glob(f"{PREFIX}*"):
        owner = folder.name.removeprefix(PREFIX).partition("-")[0]
        if owner.isdecimal() and not Path("/proc", owner).exists():
            shutil.rmtree(folder, ignore_errors=True)


class PtyPort:
    """A pseudo-terminal through which a client reaches a device.

    `address` is the path for the client: a link to the terminal, like the links in /dev/serial/by-id. While
    the terminal is unplugged, the link is missing. When the terminal is plugged in again, the link has the
    same path as before.
    """

    def __init__(self, wire: WireProtocol) -> None:
        self._wire = wire
        _sweep()
        self._folder = tempfile.TemporaryDirectory(prefix=f"{PREFIX}{os.getpid()}-")
        self._link = Path(self._folder.name) / "tty"
        self.address = str(self._link)
        self._thread: threading.Thread | None = None
        self._line_lock = threading.RLock()
        self.plug_in()
        wire.faults.when("unplug", self.unplug, self.plug_in)

    def plug_in(self) -> None:
        """Create the pseudo-terminal; do nothing if it exists."""
        if self._thread is not None:
            return
        # Keep the client's end open here too, so that a client can close and reopen the terminal.
        self._near, self._far = os.openpty()
        tty.setraw(self._far)
        os.set_blocking(self._near, False)
        self._link.symlink_to(os.ttyname(self._far))
        self._wake_read, self._wake_write = os.pipe()
        self._closing = threading.Event()
        self._line = Line(self._wire, self._send, self._closing.wait)
        self._thread = threading.Thread(target=self._serve, name=f"serve {self.address}", daemon=True)
        self._thread.start()

    def _serve(self) -> None:
        while True:
            ready, _, _ = select.select([self._near, self._wake_read], [], [])
            if self._wake_read in ready:
                return
            received = os.read(self._near, 4096)
            with self._line_lock:
                self._line.receive(received)

    def tick(self, message: bytes) -> None:
        """Let the device answer a message of its own clock, for a device that sends by itself."""
        with self._line_lock:
            if self._thread is not None:
                self._line.receive(message)

    def _send(self, reply: bytes) -> None:
        # As on a UART, bytes that no client reads are lost.
        with contextlib.suppress(BlockingIOError):
            os.write(self._near, reply)

    def unplug(self) -> None:
        """Remove the pseudo-terminal, even if a client uses it; a repeated call does nothing."""
        if self._thread is None:
            return
        self._link.unlink(missing_ok=True)
        self._closing.set()
        os.write(self._wake_write, b"x")
        self._thread.join()
        with self._line_lock:
            self._thread = None
            for descriptor in (self._near, self._far, self._wake_read, self._wake_write):
                os.close(descriptor)

    def close(self) -> None:
        """Unplug the terminal and remove its folder; a repeated call does nothing."""
        self.unplug()
        self._folder.cleanup()


class TcpPort:
    """A TCP port through which any number of clients reach a device.

    `address` is the address ``host:port``, which does not change when the port is unplugged and plugged in.
    """

    def __init__(self, wire: WireProtocol, host: str, port: int) -> None:
        self._wire = wire
        self._host, self._port = host, port
        self._server: TcpServer | None = None
        self._lines: dict[Line, threading.Lock] = {}
        self.plug_in()
        wire.faults.when("unplug", self.unplug, self.plug_in)

    def plug_in(self) -> None:
        """Listen on the port, unless it is plugged in already; raise `OSError` if the port is in use."""
        if self._server is not None:
            return
        self._closing = threading.Event()
        self._server = TcpServer(self._converse, self._host, self._port)
        self.address = self._server.address
        self._port = int(self.address.rpartition(":")[2])

    def _converse(self, connection: socket.socket) -> None:
        line, lock = Line(self._wire, connection.sendall, self._closing.wait), threading.Lock()
        self._lines[line] = lock
        try:
            while received := connection.recv(4096):
                with lock:
                    line.receive(received)
        finally:
            del self._lines[line]

    def tick(self, message: bytes) -> None:
        """Let the device answer a message of its own clock to every client."""
        for line, lock in list(self._lines.items()):
            # a client that has just gone needs no answer
            with lock, contextlib.suppress(OSError):
                line.receive(message)

    def drop_clients(self) -> None:
        """Close every connection. Clients can connect again."""
        if self._server is not None:
            self._server.drop_clients()

    def unplug(self) -> None:
        """Close every connection and stop listening; a repeated call does nothing."""
        if self._server is None:
            return
        self._closing.set()
        with contextlib.suppress(OSError):
            self._server.close()
        self._server = None

    close = unplug


class Server(WireProtocol):
    """A device with its own port. A subclass defines how to split, answer and damage messages."""

    default_host: ClassVar[str | None] = None
    """The address of the server's TCP port, or None for a pseudo-terminal, if no address is given."""
    _port: PtyPort | TcpPort

    @property
    def address(self) -> str:
        """Address of the server: the path of a pseudo-terminal, or ``host:port``."""
        return self._port.address

    def drop_clients(self) -> None:
        """Close every TCP connection. Clients can connect again."""
        if isinstance(self._port, TcpPort):
            self._port.drop_clients()

    def close(self) -> None:
        """Close the port and end its threads; a repeated call does nothing."""
        self._port.close()


class LineServer(Server, ABC):
    """A device whose messages are lines of text, of at most `line_max` bytes."""

    line_max: ClassVar[int]

    def __init__(self) -> None:
        self._turn = threading.Lock()

    def cut(self, buffer: bytes) -> tuple[list[bytes], bytes]:
        """Return the complete lines in a buffer, and the remaining bytes."""
        *lines, rest = re.split(rb"[\r\n]", buffer)
        return [line for line in lines if line], rest[-self.line_max :]

    def respond(self, message: bytes) -> bytes:
        """Execute one line and return the answer. Only one client's line is executed at a time."""
        with self._turn:
            return self.answer(message)

    @abstractmethod
    def answer(self, line: bytes) -> bytes:
        """Execute one line and return the answer, which may be empty."""


def port_of(wire: WireProtocol, host: str | None, port: int) -> PtyPort | TcpPort:
    """Open a TCP port if `host` is given, otherwise a pseudo-terminal. Port 0 takes any free TCP port."""
    return PtyPort(wire) if host is None else TcpPort(wire, host, port)
