"""The server of the HTTP interface, on a thread of its own."""

import os
import secrets
import socket
import threading
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from drivers.clock import SystemClock
from rig.errors import ProtocolError

if TYPE_CHECKING:
    from rig.news.http_api import RunView

HOST = "127.0.0.1"
TOKEN_VARIABLE = "OFFAXIS_HTTP_TOKEN"
_TOKEN_MIN = 16
_STARTING_S = 10.0
_LEAVING_S = 1.0
"""Time in s for programs that follow the events to receive the last events."""
_POLL_S = 0.02
_SILENT = {
    "version": 1,
    "disable_existing_loggers": False,
    "handlers": {"none": {"class": "logging.NullHandler"}},
    "loggers": {"uvicorn": {"handlers": ["none"], "propagate": False}},
}


class HttpPlace:
    """A port of this computer that is reserved for the interface, and the token for an abort.

    Port 0 means any free port. Raise `ProtocolError` if the port is in use, the libraries are not installed,
    or the token in the environment is too short.
    """

    def __init__(self, port: int) -> None:
        if find_spec("starlette") is None or find_spec("uvicorn") is None:
            raise ProtocolError(
                "HTTP",
                "the packages starlette and uvicorn",
                "no such packages",
                "install them with pip install 'offaxis[http]', or leave out --http",
            )
        self.token = os.environ.get(TOKEN_VARIABLE) or secrets.token_urlsafe(24)
        if len(self.token) < _TOKEN_MIN or not self.token.isascii():
            raise ProtocolError(
                f"HTTP, the token in {TOKEN_VARIABLE}",
                f"at least {_TOKEN_MIN} letters or digits",
                f"{len(self.token)} characters",
                f"give a longer token, or unset {TOKEN_VARIABLE}",
            )
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        try:
            self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            self.socket.bind((HOST, port))
        except OSError as error:
            self.socket.close()
            raise ProtocolError(
                f"HTTP, port {port}",
                "a free port",
                error.strerror or str(error),
                "name another port with --http, such as 0 for any free one",
            ) from error
        self.port: int = self.socket.getsockname()[1]

    @property
    def url(self) -> str:
        """The address of the interface."""
        return f"http://{HOST}:{self.port}/v1/"

    def close(self) -> None:
        """Release the port."""
        self.socket.close()


class HttpServer:
    """Serves the interface from `start` to `stop`."""

    def __init__(self, place: HttpPlace, view: "RunView") -> None:
        import uvicorn

        from rig.news.http_api import make_app
        from rig.news.http_connections import WAITING_MAX, BoundedConnection

        config = uvicorn.Config(
            make_app(view),
            http=BoundedConnection,
            backlog=WAITING_MAX,
            ws="none",
            lifespan="off",
            loop="asyncio",
            log_config=_SILENT,
            access_log=False,
            server_header=False,
            timeout_keep_alive=5,
            timeout_graceful_shutdown=1,
        )
        self._place = place
        self._view = view
        self._server: Any = uvicorn.Server(config)
        self._thread = threading.Thread(target=self._run, name="HTTP interface", daemon=True)

    def start(self) -> None:
        """Begin to serve. Raise `ProtocolError` if the server does not start."""
        self._thread.start()
        clock = SystemClock()
        end_s = clock.now_s() + _STARTING_S
        while not self._server.started:
            if clock.now_s() > end_s or not self._thread.is_alive():
                raise ProtocolError("HTTP", "a server that starts", "none", "leave out --http")
            clock.sleep(_POLL_S)

    def stop(self) -> None:
        """End the server. Close the bulletin before this call, so that programs receive all events."""
        self._server.should_exit = True
        self._thread.join(2.0 * _LEAVING_S + 1.0)
        self._place.close()

    def _run(self) -> None:
        self._server.run(sockets=[self._place.socket])
