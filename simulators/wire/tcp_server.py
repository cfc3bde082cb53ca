"""A TCP server for any number of clients; closing the server ends all its threads and connections."""

import contextlib
import socket
import threading
from collections.abc import Callable

RETRY_S = 0.05


class TcpServer:
    """A server that accepts connections and serves each connection in its own daemon thread.

    ``converse(connection)`` serves one client. The function must return when `recv` returns no bytes, and may
    raise `OSError`. The server then closes the connection. `port` is the TCP port; 0 takes any free port.
    Raise `OSError` if the port is in use.
    """

    def __init__(self, converse: Callable[[socket.socket], None], host: str, port: int) -> None:
        self._converse = converse
        self._listener = socket.create_server((host, port))
        bound_host, bound_port = self._listener.getsockname()[:2]
        self.address = f"{bound_host}:{bound_port}"
        self._lock = threading.Lock()
        self._closing = threading.Event()
        self._talks: dict[socket.socket, threading.Thread] = {}
        self._accepting = threading.Thread(target=self._accept, name=f"accept {self.address}", daemon=True)
        self._accepting.start()

    def _accept(self) -> None:
        while True:
            try:
                connection, _ = self._listener.accept()
            except OSError:
                # This process has no free file descriptor at the moment, so let the client wait.
                if self._closing.wait(RETRY_S):
                    return
                continue
            with self._lock:
                if self._closing.is_set():
                    connection.close()
                    return
                talk = threading.Thread(
                    target=self._talk, args=(connection,), name=f"serve {self.address}", daemon=True
                )
                # Remove only threads that have ended, so that `drop_clients` waits for all other threads.
                self._talks = {each: thread for each, thread in self._talks.items() if thread.is_alive()}
                self._talks[connection] = talk
                talk.start()

    def _talk(self, connection: socket.socket) -> None:
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        with connection, contextlib.suppress(OSError):
            self._converse(connection)

    def drop_clients(self) -> None:
        """Close every connection, as after a break of the cable. Clients can connect again."""
        with self._lock:
            talks = dict(self._talks)
        for connection in talks:
            with contextlib.suppress(OSError):
                connection.shutdown(socket.SHUT_RDWR)
        for talk in talks.values():
            talk.join()

    def close(self) -> None:
        """Stop listening, close every connection and wait for the threads; a repeated call does nothing."""
        with self._lock:
            self._closing.set()
        # `close` alone does not wake a thread that waits in `accept`.
        with contextlib.suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._accepting.join()
        self._listener.close()
        self.drop_clients()
