"""The client's end of a device: a pseudo-terminal or a TCP port, which can be unplugged and plugged in."""

import contextlib
import functools
import os
import select
import shutil
import socket
import tempfile
import threading
import tty
from pathlib import Path

from simulators.wire.line import Line, Wire
from simulators.wire.tcp_server import TcpServer

LOCALHOST = "127.0.0.1"
PREFIX = "offaxis-pty-"
"""Prefix of the folders that hold links to terminals."""


@functools.cache
def _sweep() -> None:
    """Remove the links that killed processes left behind; done once per process."""
    for folder in Path(tempfile.gettempdir()).glob(f"{PREFIX}*"):
        owner = folder.name.removeprefix(PREFIX).partition("-")[0]
        if owner.isdecimal() and not Path("/proc", owner).exists():
            shutil.rmtree(folder, ignore_errors=True)


class PtyPort:
    """A pseudo-terminal with the device at its near end.

    Attributes
    ----------
    address : str
        The path to open: a link to the terminal, as /dev/serial/by-id has them. The link disappears
        while the terminal is unplugged and returns afterwards, under the same name.
    """

    def __init__(self, wire: Wire) -> None:
        self._wire = wire
        _sweep()
        self._folder = tempfile.TemporaryDirectory(prefix=f"{PREFIX}{os.getpid()}-")
        self._link = Path(self._folder.name) / "tty"
        self.address = str(self._link)
        self._thread: threading.Thread | None = None
        self.plug_in()
        wire.faults.when("unplug", self.unplug, self.plug_in)

    def plug_in(self) -> None:
        """Make the terminal; harmless when it is there."""
        if self._thread is not None:
            return
        # our own descriptor of the far end stays open, so that a client may leave and come back
        self._near, self._far = os.openpty()
        tty.setraw(self._far)
        os.set_blocking(self._near, False)
        self._link.symlink_to(os.ttyname(self._far))
        self._wake_read, self._wake_write = os.pipe()
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._serve, name=f"serve {self.address}", daemon=True)
        self._thread.start()

    def _serve(self) -> None:
        line = Line(self._wire, self._send, self._closing.wait)
        while True:
            ready, _, _ = select.select([self._near, self._wake_read], [], [])
            if self._wake_read in ready:
                return
            line.receive(os.read(self._near, 4096))

    def _send(self, reply: bytes) -> None:
        # as on a UART, bytes that nobody reads are lost
        with contextlib.suppress(BlockingIOError):
            os.write(self._near, reply)

    def unplug(self) -> None:
        """Take the terminal away under the client; harmless when repeated."""
        if self._thread is None:
            return
        self._link.unlink(missing_ok=True)
        self._closing.set()
        os.write(self._wake_write, b"x")
        self._thread.join()
        self._thread = None
        for descriptor in (self._near, self._far, self._wake_read, self._wake_write):
            os.close(descriptor)

    def close(self) -> None:
        """Unplug it for good; harmless when repeated."""
        self.unplug()
        self._folder.cleanup()


class TcpPort:
    """A TCP port with the device behind it, for any number of clients.

    Attributes
    ----------
    address : str
        ``host:port``; the same after unplugging.
    """

    def __init__(self, wire: Wire, host: str, port: int) -> None:
        self._wire = wire
        self._host, self._port = host, port
        self._server: TcpServer | None = None
        self.plug_in()
        wire.faults.when("unplug", self.unplug, self.plug_in)

    def plug_in(self) -> None:
        """Listen; harmless when repeated. `OSError` if the port is taken."""
        if self._server is not None:
            return
        self._closing = threading.Event()
        self._server = TcpServer(self._converse, self._host, self._port)
        self.address = self._server.address
        self._port = int(self.address.rpartition(":")[2])

    def _converse(self, connection: socket.socket) -> None:
        line = Line(self._wire, connection.sendall, self._closing.wait)
        while received := connection.recv(4096):
            line.receive(received)

    def drop_clients(self) -> None:
        """Cut every connection, as a switch would; new ones are accepted."""
        if self._server is not None:
            self._server.drop_clients()

    def unplug(self) -> None:
        """Cut every connection and listen no more; harmless when repeated."""
        if self._server is None:
            return
        self._closing.set()
        with contextlib.suppress(OSError):
            self._server.close()
        self._server = None

    close = unplug


class Server:
    """A device with a port of its own; a subclass says how its messages are cut, answered and damaged.

    Attributes
    ----------
    address : str
        The path of a pseudo-terminal, or ``host:port``.
    """

    _port: PtyPort | TcpPort

    @property
    def address(self) -> str:
        """Where it is found."""
        return self._port.address

    def drop_clients(self) -> None:
        """Cut every connection over TCP; new ones are accepted."""
        if isinstance(self._port, TcpPort):
            self._port.drop_clients()

    def close(self) -> None:
        """Hang up and end the threads; harmless when repeated."""
        self._port.close()


def port_of(wire: Wire, host: str | None, port: int) -> PtyPort | TcpPort:
    """Open a wire's port: TCP at a host, where 0 takes any free port, or without one a pseudo-terminal."""
    return PtyPort(wire) if host is None else TcpPort(wire, host, port)
