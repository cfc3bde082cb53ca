"""A simulated device that never stops sending."""

import socket
from collections.abc import Iterator
from contextlib import contextmanager

from simulators.wire.tcp_server import TcpServer


@contextmanager
def flood(data: bytes) -> Iterator[str]:
    """Yield the address of a server that sends `data` again and again to each client."""

    def converse(connection: socket.socket) -> None:
        while True:
            connection.sendall(data)

    server = TcpServer(converse, "127.0.0.1", 0)
    try:
        yield f"socket://{server.address}"
    finally:
        server.close()
