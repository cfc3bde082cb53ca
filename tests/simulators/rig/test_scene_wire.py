"""Tests of the server for the simulation's cameras: several clients, bad requests, other servers."""

import contextlib
import json
import math
import socket
import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing

import pytest

from drivers.errors import DeviceError, DeviceTimeout, LinkLost
from drivers.interfaces import Frame, OpenContext
from simulators.rig.camera import SPEC as CAMERA_SPEC
from simulators.rig.scene_client import CAMERA, RENDERING_S, RemoteCamera, SceneClient
from simulators.rig.scene_wire import SceneServer
from simulators.wire.tcp_server import TcpServer


def test_errors_of_its_cameras_come_through(simulation, rig):
    simulation.command("fault camera.unplug")
    with pytest.raises(LinkLost, match=r"cameras.front \(.*\): grab: expected a camera on its cable"):
        rig.cameras["front"].grab(5.0)
    simulation.command("clear")
    with pytest.raises(DeviceTimeout, match=r"expected a frame within 0\.001 s"):
        rig.cameras["front"].grab(0.001)
    assert rig.cameras["front"].grab(5.0).flags == 0


def test_a_frame_keeps_the_middle_of_its_exposure_on_the_way(rig):
    frame = rig.cameras["front"].grab(5.0)
    assert frame.exposed_s < frame.middle_s < frame.received_s
    # in real time the simulated camera needs a moment to look
    assert 0.0 <= frame.middle_std_s < 0.05


def test_one_camera_exposes_one_frame_at_a_time_whoever_asks(simulation, monkeypatch):
    camera = CAMERA_SPEC.open(
        CAMERA_SPEC.settings(width_px=16, height_px=16),
        OpenContext("x", simulation.rig.clock, simulation.rig),
    )
    together = threading.Barrier(2)

    def grab(timeout_s: float) -> Frame:
        # broken unless two are in here at once
        with contextlib.suppress(threading.BrokenBarrierError):
            together.wait(0.1)
            pytest.fail("two frames at once")
        raise DeviceTimeout("camera", "grab", "a frame", "none", "none")

    monkeypatch.setattr(camera, "grab", grab)
    with closing(SceneServer({"x": camera}, None, None)) as server, ThreadPoolExecutor(2) as pool:

        def ask() -> None:
            with closing(SceneClient("camera", server.address)) as client:
                client.ask(10.0, do="grab", camera="x", timeout_s=1.0)

        for asked in [pool.submit(ask) for _ in range(2)]:
            with pytest.raises(DeviceTimeout):
                asked.result()


def test_two_threads_do_not_talk_at_once_on_one_connection():
    together = threading.Barrier(2)

    class Client:
        name = "camera"

        def ask(self, timeout_s: float, /, **request: object) -> tuple[dict[str, object], bytes]:
            if request["do"] == "camera":
                return {"vendor": "v", "model": "m", "serial": "s"}, b""
            # broken unless two are in here at once
            with contextlib.suppress(threading.BrokenBarrierError):
                together.wait(0.1)
                pytest.fail("two questions at once")
            raise DeviceTimeout("camera", "grab", "a frame", "none", "none")

    camera = RemoteCamera(Client(), "x")
    with ThreadPoolExecutor(2) as pool:
        for asked in [pool.submit(camera.grab, 1.0) for _ in range(2)]:
            with pytest.raises(DeviceTimeout):
                asked.result()


def test_a_frame_may_take_its_time_to_be_rendered():
    timeouts_s = []

    class Client:
        def ask(self, timeout_s: float, /, **request: object) -> tuple[dict[str, object], bytes]:
            timeouts_s.append(timeout_s)
            if request["do"] == "camera":
                return {"vendor": "v", "model": "m", "serial": "s"}, b""
            raise DeviceTimeout("camera", "grab", "a frame", "none", "none")

    with pytest.raises(DeviceTimeout):
        RemoteCamera(Client(), "x").grab(2.0)
    assert timeouts_s == [RENDERING_S, 2.0 + RENDERING_S]


def test_a_simulation_that_ended_is_said_so(simulation, rig):
    simulation.close()
    with pytest.raises(LinkLost, match="start rig simulate"):
        rig.cameras["front"].grab(5.0)


def test_nonsense_on_the_port_of_the_scene_is_answered(simulation):
    client = SceneClient("cameras.x", simulation.addresses["scene"])
    simulation.switch_on("camera.stall")
    grab = {"do": "grab", "camera": "front"}
    for request in (
        {"do": "dance"},
        {"do": "grab", "camera": "none", "timeout_s": 1.0},
        {"do": "operator"},
        *(grab | {"timeout_s": timeout_s} for timeout_s in (math.inf, math.nan, 1e30, -1.0)),
        {"do": "x" * 100_000},
    ):
        with pytest.raises(DeviceError, match="expected camera, settings, grab, stream, operator or ask"):
            client.ask(10.0, **request)
        # what is left of the longest
        client.close()
    # Python 3.11 gives up JSON of this depth, and Python 3.13 reads it.
    deep = b"[" * 2000 + b"]" * 2000 + b"\n"
    host, port = simulation.addresses["scene"].split(":")
    with socket.create_connection((host, int(port)), 10.0) as raw:
        raw.sendall(deep)
        answer = json.loads(raw.makefile("rb").readline())
    assert answer["step"] == "understand a request"
    assert answer["got"].split()[0] in {"RecursionError", "TypeError"}


def test_half_a_frame_is_a_lost_link():
    def half(connection: socket.socket) -> None:
        connection.recv(4096)
        connection.sendall(b'{"bytes": 100}\n' + bytes(10))

    server = TcpServer(half, "127.0.0.1", 0)
    try:
        client = SceneClient("cameras.x", server.address)
        with pytest.raises(LinkLost, match="10 of 100 bytes"):
            client.ask(10.0, do="grab", camera="x", timeout_s=1.0)
    finally:
        server.close()


@pytest.mark.parametrize("answer", [b"", b"{", b"[]\n", b"HTTP/1.1 400 Bad Request\r\n"])
def test_another_program_at_its_address_is_told_from_it(answer):
    def other(connection: socket.socket) -> None:
        connection.recv(4096)
        connection.sendall(answer)

    server = TcpServer(other, "127.0.0.1", 0)
    try:
        with pytest.raises(LinkLost, match="start rig simulate"):
            SceneClient("cameras.x", server.address).ask(10.0, do="camera", camera="x")
    finally:
        server.close()


def test_a_camera_needs_a_simulation():
    with pytest.raises(LinkLost, match="start rig simulate"):
        CAMERA.open(CAMERA.settings(address="127.0.0.1:1", camera="x"), OpenContext("cameras.x", None))
