"""Drivers for the cameras and the operator of a virtual rig that runs in another program on this machine."""

import json
import select
import socket
import threading
from contextlib import suppress
from datetime import datetime
from typing import Any

import numpy as np
from pydantic import Field

from drivers import errors
from drivers.clock import Clock
from drivers.errors import DeviceError, DeviceFault, DeviceTimeout, LinkLost
from drivers.interfaces import (
    CameraInfo,
    Frame,
    OpenContext,
    OperatorAction,
    OperatorQuestion,
    Setting,
)
from drivers.registry import DriverSpec
from drivers.settings import Settings
from drivers.streams.stream import CAPACITY, FrameStream
from simulators.rig.operator import Asked, notice, said

ANSWER_S = 2.0
"""Timeout in s for a request that needs no rendering."""

RENDERING_S = 30.0
"""Time in s added to the timeout of a frame, because rendering is slow on a busy machine."""

OPERATOR_S = 3630.0
"""Timeout in s for the operator, longer than the longest duration that a rig file can set."""


class _RemoteSettings(Settings):
    address: str = Field(pattern=r"^.+:\d+$", description="host:port")


class RemoteOperatorSettings(_RemoteSettings):
    """Address of the simulation, as printed by ``rig simulate``, and the duration of the operator's actions.

    The duration is only shown to the user. The simulation determines how long an action takes.
    """

    duration_s: float | None = Field(default=None, ge=0, le=3600)


class RemoteCameraSettings(_RemoteSettings):
    """Address of the simulation, and name of a camera in the simulation."""

    camera: str


class SceneClient:
    """A connection to a `simulators.rig.scene_wire.SceneServer`. The first request opens the connection.

    `name` is the name of the device in the rig file. The attribute `name` has the address too, for error
    messages. `address` is ``host:port``.
    """

    def __init__(self, name: str, address: str) -> None:
        self.name = f"{name} ({address})"
        self._address = address
        self._socket: socket.socket | None = None

    def beside(self) -> "SceneClient":
        """Return another connection to the same simulation."""
        client = SceneClient("", self._address)
        client.name = self.name
        return client

    def ask(self, timeout_s: float, /, **request: object) -> tuple[dict[str, Any], bytes]:
        """Send a request; return the JSON object of the answer and the bytes that follow the object.

        Raise the error of the simulated device, with the name of this device, or `LinkLost` if the simulation
        has ended.
        """
        try:
            if self._socket is None:
                host, _, port = self._address.rpartition(":")
                self._socket = socket.create_connection((host, int(port)), timeout_s)
            self._socket.settimeout(timeout_s)
            self._socket.sendall(json.dumps(request).encode() + b"\n")
        except OSError as error:
            raise self._lost(str(request["do"]), error) from error
        return self._receive(str(request["do"]))

    def _receive(self, step: str) -> tuple[dict[str, Any], bytes]:
        assert self._socket is not None
        try:
            # Without a buffer, nothing of a frame that follows in a stream is read and lost.
            with self._socket.makefile("rb", buffering=0) as answer:
                if not (line := answer.readline()).endswith(b"\n"):
                    raise ConnectionResetError("the other end closed the connection")
                head = json.loads(line)
                body = bytearray(head.get("bytes", 0))
                filled = 0
                while filled < len(body):
                    if not (count := answer.readinto(memoryview(body)[filled:])):
                        raise ConnectionResetError(f"{filled} of {len(body)} bytes")
                    filled += count
        except (OSError, ValueError, AttributeError) as error:
            raise self._lost(step, error) from error
        if "error" in head:
            kind = getattr(errors, head.pop("error"), DeviceError)
            del head["device"]  # the rig file may use another name for the device
            raise kind(self.name, head.pop("step"), **head)
        return head, bytes(body)

    def _lost(self, step: str, error: Exception) -> LinkLost:
        self.close()
        return LinkLost(
            self.name,
            step,
            "an answer of the simulation",
            str(error) or type(error).__name__,
            "start rig simulate and take the addresses that it prints",
        )

    def await_frame(self, timeout_s: float) -> tuple[dict[str, Any], bytes] | None:
        """Return the next frame of a stream that was asked for, None if none begins to arrive in time.

        Raise the errors of `ask`.
        """
        assert self._socket is not None
        if not select.select([self._socket], [], [], max(0.0, timeout_s))[0]:
            return None
        return self._receive("stream")

    def end_stream(self, timeout_s: float) -> None:
        """End a stream, wait until the simulation has ended it too, and close the connection."""
        if self._socket is not None:
            with suppress(OSError):
                self._socket.shutdown(socket.SHUT_WR)
                self._socket.settimeout(timeout_s)
                while self._socket.recv(1 << 20):
                    pass
        self.close()

    def close(self) -> None:
        """Close the connection; a repeated call does nothing."""
        if self._socket is not None:
            # `shutdown` wakes another thread that waits for an answer. `close` alone would not wake it.
            with suppress(OSError):
                self._socket.shutdown(socket.SHUT_RDWR)
            self._socket.close()
        self._socket = None


class RemoteCamera:
    """A `Camera` whose images another program renders.

    Frame times are given on this computer's monotonic clock, which both programs share.
    """

    def __init__(self, client: SceneClient, camera: str) -> None:
        self._client, self._camera = client, camera
        self._turn = threading.Lock()
        self._closed = False
        head, _ = client.ask(RENDERING_S, do="camera", camera=camera)
        self.info = CameraInfo(**head)

    def grab(self, timeout_s: float) -> Frame:
        """Return a frame whose exposure began after this call.

        Raise the error of the simulated camera, `LinkLost` if the simulation has ended, or `DeviceFault`
        after `close`.
        """
        if not timeout_s > 0.0:
            raise self._error(DeviceTimeout, f"a frame within {timeout_s:g} s", "none", "allow more time")
        with self._turn:
            if self._closed:
                raise self._error(DeviceFault, "an open camera", "a closed one", "open it again")
            head, pixels = self._client.ask(
                timeout_s + RENDERING_S, do="grab", camera=self._camera, timeout_s=timeout_s
            )
        return _frame(head, pixels)

    def read_settings(self) -> dict[str, Setting]:
        """Return the settings of the simulated camera; the errors are those of `grab`."""
        with self._turn:
            if self._closed:
                raise self._error(DeviceFault, "an open camera", "a closed one", "open it again")
            head, _ = self._client.ask(ANSWER_S, do="settings", camera=self._camera)
        settings: dict[str, Setting] = head["settings"]
        return settings

    def close(self) -> None:
        """Release the camera; a repeated call does nothing."""
        with self._turn:
            self._closed = True
            self._client.close()

    def _error(self, kind: type[DeviceError], expected: str, got: str, remedy: str) -> DeviceError:
        return kind(self._client.name, "grab", expected, got, remedy)


class FilmingRemoteCamera(RemoteCamera):
    """A `RemoteCamera` that films by itself: its method `stream` delivers all frames.

    `rate_hz` is the rate of the frames.
    """

    def __init__(self, client: SceneClient, camera: str, clock: Clock, rate_hz: float) -> None:
        super().__init__(client, camera)
        self._clock, self._rate_hz = clock, rate_hz

    def stream(self, capacity: int = CAPACITY) -> FrameStream:
        """Return a stream of all frames from now on, on a connection of its own.

        `capacity` is the largest number of frames in the queue. Raise the errors of `grab`.
        """
        filming = self._client.beside()
        filming.ask(ANSWER_S, do="stream", camera=self._camera, capacity=capacity)

        def next_frame(timeout_s: float) -> Frame | None:
            received = filming.await_frame(timeout_s)
            return None if received is None else _frame(*received)

        return FrameStream(
            self._client.name,
            next_frame,
            self._clock,
            interval_s=1.0 / self._rate_hz,
            silence_s=max(ANSWER_S, 10.0 / self._rate_hz),
            capacity=capacity,
            on_close=lambda: filming.end_stream(ANSWER_S + 2.0 / self._rate_hz),
        )


def _frame(head: dict[str, Any], pixels: bytes) -> Frame:
    image = np.frombuffer(pixels, head.pop("dtype")).reshape(head.pop("shape"))
    head.pop("bytes")
    return Frame(image=image, utc=datetime.fromisoformat(head.pop("utc")), **head)


class RemoteOperator:
    """The operator of a rig that another program simulates."""

    def __init__(self, client: SceneClient, duration_s: float | None = None) -> None:
        self._client = client
        self._duration_s = duration_s

    def notice(self, action: Asked) -> str:
        """Return a sentence on the simulated operator's action, and its duration if it is known."""
        if self._duration_s is None:
            return f"simulated operator: {said(action)}"
        return notice(action, self._duration_s)

    def perform(self, action: OperatorAction) -> None:
        """Ask the simulation to attach or remove the grid; return after the action is done."""
        self._client.ask(OPERATOR_S, do="operator", action=action.name)

    def ask(self, question: OperatorQuestion) -> None:
        """Let the simulation answer a question of the protocol; return after the answer."""
        self._client.ask(OPERATOR_S, do="ask", text=question.text, word=question.word)

    def withdraw(self) -> None:
        """Do nothing, because a simulated operator waits for nobody."""

    def close(self) -> None:
        """Close the connection; a repeated call does nothing."""
        self._client.close()


def _open_camera(settings: RemoteCameraSettings, context: OpenContext) -> RemoteCamera:
    client = SceneClient(context.name, settings.address)
    answer, _ = client.ask(ANSWER_S, do="settings", camera=settings.camera)
    rate_hz = answer["settings"].get("rate_hz")
    if rate_hz is None:
        return RemoteCamera(client, settings.camera)
    return FilmingRemoteCamera(client, settings.camera, context.clock, rate_hz)


def _open_operator(settings: RemoteOperatorSettings, context: OpenContext) -> RemoteOperator:
    return RemoteOperator(SceneClient(context.name, settings.address), settings.duration_s)


CAMERA = DriverSpec("camera", RemoteCameraSettings, _open_camera)
OPERATOR = DriverSpec("operator", RemoteOperatorSettings, _open_operator)
