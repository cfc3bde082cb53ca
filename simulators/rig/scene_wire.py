"""A TCP server that gives other programs the cameras and the operator of a virtual rig.

A request is one line with a JSON object that has the key ``do``. The answer is one line with a JSON object.
After the answer to ``grab``, the pixels of the frame follow.

====================================================  ================================================
``{"do": "camera", "camera": NAME}``                  the camera's `drivers.interfaces.CameraInfo`
``{"do": "settings", "camera": NAME}``                ``settings``: the settings that the camera reports
``{"do": "grab", "camera": NAME, "timeout_s": S}``    all values of `drivers.interfaces.Frame` except the
                                                      image; ``shape`` and ``dtype`` of the image; and
                                                      ``bytes``, the number of pixel bytes that follow, row
                                                      by row
``{"do": "stream", "camera": NAME, "capacity": N}``   an empty object; then all frames of the camera, each as
                                                      the answer to ``grab``, until the client closes the
                                                      connection or the stream ends with an error
``{"do": "operator", "action": "ATTACH_GRID"}``       an empty object after the action is done; the other
                                                      actions are ``REMOVE_GRID`` and ``GO_ON``
``{"do": "ask", "text": TEXT, "word": WORD}``         an empty object after the question is answered
====================================================  ================================================

The answer to a failed request is the object ``{"error": KIND, "device": …, "step": …, "expected": …, "got":
…, "remedy": …}``.
"""

import json
import select
import socket
import threading
from collections.abc import Callable, Mapping
from dataclasses import asdict
from typing import Any

from drivers.errors import DeviceError
from drivers.interfaces import Frame, OperatorAction, OperatorQuestion
from simulators.rig.camera import FreeRunningCamera, SimulatedCamera
from simulators.rig.operator import SimulatedOperator
from simulators.wire.ports import LOCALHOST
from simulators.wire.tcp_server import TcpServer

LINE_MAX = 4096
TIMEOUT_MAX_S = 3600.0


class SceneServer:
    """A TCP server for the cameras and the operator of a virtual rig.

    `on_frame` is a function that is called for each sent frame, with the camera's name, the camera and the
    frame. `port` is the TCP port; 0 takes any free port. `address` is the address of the server,
    ``host:port``.
    """

    def __init__(
        self,
        cameras: Mapping[str, SimulatedCamera],
        operator: SimulatedOperator,
        on_frame: Callable[[str, SimulatedCamera, Frame], None],
        port: int = 0,
    ) -> None:
        self._cameras = cameras
        self._operator = operator
        self._on_frame = on_frame
        self._turns = {name: threading.Lock() for name in cameras}
        self._server = TcpServer(self._converse, LOCALHOST, port)
        self.address = self._server.address

    def close(self) -> None:
        """Stop the server; a repeated call does nothing."""
        self._server.close()

    def _converse(self, connection: socket.socket) -> None:
        with connection.makefile("rb") as lines:
            while line := lines.readline(LINE_MAX):
                head, body = self._answer(line)
                connection.sendall(json.dumps(head).encode() + b"\n" + body)
                if "stream" in head:
                    self._film(connection, head["stream"], head["capacity"])
                    return

    def _answer(self, line: bytes) -> tuple[dict[str, Any], bytes]:
        try:
            request = json.loads(line)
            match request["do"]:
                case "camera":
                    return asdict(self._cameras[request["camera"]].info), b""
                case "settings":
                    return {"settings": self._cameras[request["camera"]].read_settings()}, b""
                case "grab":
                    return self._grab(request["camera"], float(request["timeout_s"]))
                case "stream":
                    return self._require_stream(request["camera"], int(request["capacity"]))
                case "operator":
                    self._operator.perform(OperatorAction[request["action"]])
                    return {}, b""
                case "ask":
                    self._operator.ask(OperatorQuestion(str(request["text"]), str(request["word"])))
                    return {}, b""
        except DeviceError as error:
            return _refusal(error), b""
        except (ValueError, TypeError, KeyError, RecursionError) as error:
            return _misunderstood(f"{type(error).__name__} {error}"), b""
        return _misunderstood(repr(request["do"])), b""

    def _grab(self, name: str, timeout_s: float) -> tuple[dict[str, Any], bytes]:
        camera = self._cameras[name]
        if not 0.0 <= timeout_s <= TIMEOUT_MAX_S:
            raise ValueError(f"timeout_s {timeout_s:g}, which is not within 0 to {TIMEOUT_MAX_S:g}")
        with self._turns[name]:
            frame = camera.grab(timeout_s)
            self._on_frame(name, camera, frame)
        return _message(frame)

    def _require_stream(self, name: str, capacity: int) -> tuple[dict[str, Any], bytes]:
        if not isinstance(self._cameras[name], FreeRunningCamera) or capacity < 1:
            raise ValueError(f"a stream of {capacity} frames of {name}, which has no fps or no frames")
        return {"stream": name, "capacity": capacity}, b""

    def _film(self, connection: socket.socket, name: str, capacity: int) -> None:
        """Send all frames of a camera, until the client closes the connection."""
        camera = self._cameras[name]
        assert isinstance(camera, FreeRunningCamera)
        try:
            with camera.stream(capacity) as stream:
                for frame in stream:
                    self._on_frame(name, camera, frame)
                    head, pixels = _message(frame)
                    connection.sendall(json.dumps(head).encode() + b"\n" + pixels)
                    if select.select([connection], [], [], 0.0)[0]:
                        return  # the client has closed the connection
        except DeviceError as error:
            connection.sendall(json.dumps(_refusal(error)).encode() + b"\n")


def _message(frame: Frame) -> tuple[dict[str, Any], bytes]:
    """Return a frame as a JSON object and the bytes of its pixels."""
    pixels = frame.image.tobytes()
    head = {**vars(frame), "utc": frame.utc.isoformat(), "bytes": len(pixels)}
    image = head.pop("image")
    return {**head, "shape": image.shape, "dtype": str(image.dtype)}, pixels


def _refusal(error: DeviceError) -> dict[str, Any]:
    said = {part: getattr(error, part) for part in ("device", "step", "expected", "got", "remedy")}
    return {"error": type(error).__name__, **said}


def _misunderstood(got: str) -> dict[str, Any]:
    return {
        "error": "DeviceError",
        "device": "the simulated scene",
        "step": "understand a request",
        "expected": "camera, settings, grab, stream, operator or ask with what belongs to it",
        "got": got,
        "remedy": "see docs/simulators.md",
    }
