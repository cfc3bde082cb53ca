"""Tests of the TCP port of simulated devices if the system has no free file descriptors."""

import errno
import socket

from simulators.wire.tcp_server import TcpServer


class Exhausted:
    """A listening socket that fails once, as if the process had no free file descriptors."""

    def __init__(self, listener: socket.socket) -> None:
        self._listener = listener
        self.refusals = 0

    def accept(self) -> tuple[socket.socket, object]:
        if not self.refusals:
            self.refusals = 1
            raise OSError(errno.EMFILE, "Too many open files")
        return self._listener.accept()

    def __getattr__(self, name: str) -> object:
        return getattr(self._listener, name)


def echo(connection: socket.socket) -> None:
    while received := connection.recv(100):
        connection.sendall(received)


def test_clients_are_served_once_there_are_descriptors_again(monkeypatch):
    create = socket.create_server
    listeners: list[Exhausted] = []

    def passed(address: tuple[str, int]) -> Exhausted:
        listeners.append(Exhausted(create(address)))
        return listeners[-1]

    monkeypatch.setattr(socket, "create_server", passed)
    server = TcpServer(echo, "127.0.0.1", 0)
    try:
        host, _, port = server.address.rpartition(":")
        with socket.create_connection((host, int(port)), 10.0) as client:
            client.sendall(b"!")
            assert client.recv(1) == b"!"
        assert listeners[0].refusals == 1
    finally:
        server.close()
