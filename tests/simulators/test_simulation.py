"""The simulated rig as another program meets it: through the rig file that it writes."""

import contextlib
import json
import math
import socket
import stat
import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from datetime import datetime, timedelta

import numpy as np
import pytest

from drivers.errors import ConfigurationError, DeviceTimeout, LinkLost
from drivers.interfaces import Frame, OpenContext, OperatorAction
from rig.devices import open_rig
from rig.rigfile import read_rig
from simulators.camera import SPEC as CAMERA_SPEC
from simulators.places import SERVERS, Places
from simulators.scene_client import CAMERA, RENDERING_S, RemoteCamera, SceneClient
from simulators.scene_wire import SceneServer
from simulators.simulation import Simulation, StoppableClock
from simulators.tcp_server import TcpServer
from simulators.truth_log import TruthLog
from simulators.virtual_rig import VirtualRig, VirtualRigSettings

SMALL = {
    "driver": "simulated-camera",
    "width_px": 48,
    "height_px": 32,
    "exposure_us": 5000.0,
    "gain": 2.0,
}
TABLES = {
    "simulation": {"driver": "virtual-rig", "seed": 3},
    "stage": {"driver": "zaber-ascii", "port": "@stage_tcp", "angle_min_deg": -5.0, "angle_max_deg": 90.0},
    "load_frame": {
        "driver": "modbus-frame",
        "address": "@load_frame_rtu",
        "load_max_n": 5000.0,
        "displacement_max_mm": 2.0,
    },
    "cameras": {"front": SMALL, "side": SMALL | {"pan_deg": 20.0, "bits": 12}},
}


@pytest.fixture
def log(tmp_path):
    return tmp_path / "truth.jsonl"


@pytest.fixture
def simulation(log):
    before = set(threading.enumerate())
    started = Simulation(TABLES, "rig.toml", log)
    yield started
    started.close()
    started.close()
    assert set(threading.enumerate()) <= before


@pytest.fixture
def rig(simulation, tmp_path):
    path = tmp_path / "rig.toml"
    path.write_text(simulation.rig_file(), encoding="utf-8")
    with open_rig(read_rig(path)) as opened:
        yield opened


def lines(log, what):
    parsed = [json.loads(line) for line in log.read_text(encoding="utf-8").splitlines()]
    return [line for line in parsed if line["what"] == what]


def test_its_devices_are_reached_by_the_rig_file_it_writes(simulation, rig):
    assert (rig.stage.info.serial, rig.load_frame.info.serial) == ("110001", "220001")
    assert rig.load_frame.limits.load_max_n == 5000.0
    rig.load_frame.go_to_displacement(0.01, 0.5)
    rig.load_frame.hold()
    assert rig.load_frame.read().holding
    rig.stage.stop()
    assert simulation.rig.stage.limit_max == 90 * 6400


def test_its_cameras_show_what_is_there_now(simulation, rig):
    frame = rig.cameras["front"].grab(5.0)
    assert (frame.image.shape, frame.image.dtype, frame.sequence) == ((32, 48), np.uint8, 0)
    assert (frame.exposure_us, frame.gain) == (5000.0, 2.0)
    assert rig.cameras["side"].grab(5.0).image.dtype == np.uint16
    rig.operator.perform(OperatorAction.ATTACH_GRID)
    assert simulation.rig.scene.grid_attached
    with_grid = rig.cameras["front"].grab(5.0)
    assert with_grid.sequence == 1
    assert np.any(with_grid.image != frame.image)


def test_a_frame_is_exposed_after_it_was_asked_for(rig):
    asked_s = rig.clock.now_s()
    frame = rig.cameras["front"].grab(5.0)
    assert asked_s <= frame.exposed_s <= frame.received_s - 5e-3 <= rig.clock.now_s()


def test_the_log_keeps_what_was_true(simulation, rig, log):
    simulation.rig.stage.set_position(0)
    rig.cameras["front"].grab(5.0)
    rig.load_frame.hold()
    simulation.command("fault stage.drop:1")
    simulation.command("clear")
    simulation.log.sample()
    (frame,) = lines(log, "frame")
    assert (frame["camera"], frame["sequence"], frame["texture"]) == ("front", 0, "Speckle")
    assert frame["deformation_gradient"] == [[1.0, 0.0], [0.0, 1.0]]
    assert [line["command"] for line in lines(log, "command")] == ["hold"]
    faults = [(line["fault"], line["on"]) for line in lines(log, "fault")]
    assert faults == [("stage.drop:1", True), ("stage.drop", False)]
    (sample,) = lines(log, "sample")
    assert (sample["angle_deg"], sample["load_n"], sample["broken"]) == (0.0, 0.0, False)


def test_what_was_commanded_last_is_not_lost(simulation, log):
    simulation.rig.load_frame.hold()
    simulation.close()
    assert [line["command"] for line in lines(log, "command")] == ["hold"]


def test_what_is_told_later_bears_the_date_of_when_it_happened(log):
    rig = VirtualRig(VirtualRigSettings())
    truth = TruthLog(log, rig)
    start = rig.clock.utc()
    rig.clock.sleep(10.0)
    truth.write("command", time_s=4.0, device="stage", command="home")
    truth.close()
    rig.close()
    (line,) = lines(log, "command")
    assert datetime.fromisoformat(line["utc"]) - start == timedelta(seconds=4.0)


def test_errors_of_its_cameras_come_through(simulation, rig):
    simulation.command("fault camera.unplug")
    with pytest.raises(LinkLost, match=r"cameras.front \(.*\): grab: expected a camera on its cable"):
        rig.cameras["front"].grab(5.0)
    simulation.command("clear")
    with pytest.raises(DeviceTimeout, match=r"expected a frame within 0\.001 s"):
        rig.cameras["front"].grab(0.001)
    assert rig.cameras["front"].grab(5.0).flags == 0


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
        raise DeviceTimeout("camera", "grab", expected="a frame", got="none", remedy="none")

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

        def ask(self, patience_s: float, /, **request: object) -> tuple[dict[str, object], bytes]:
            if request["do"] == "camera":
                return {"vendor": "v", "model": "m", "serial": "s"}, b""
            # broken unless two are in here at once
            with contextlib.suppress(threading.BrokenBarrierError):
                together.wait(0.1)
                pytest.fail("two questions at once")
            raise DeviceTimeout("camera", "grab", expected="a frame", got="none", remedy="none")

    camera = RemoteCamera(Client(), "x")
    with ThreadPoolExecutor(2) as pool:
        for asked in [pool.submit(camera.grab, 1.0) for _ in range(2)]:
            with pytest.raises(DeviceTimeout):
                asked.result()


def test_a_frame_may_take_its_time_to_be_rendered():
    patience_s = []

    class Client:
        def ask(self, patience: float, /, **request: object) -> tuple[dict[str, object], bytes]:
            patience_s.append(patience)
            if request["do"] == "camera":
                return {"vendor": "v", "model": "m", "serial": "s"}, b""
            raise DeviceTimeout("camera", "grab", expected="a frame", got="none", remedy="none")

    with pytest.raises(DeviceTimeout):
        RemoteCamera(Client(), "x").grab(2.0)
    assert patience_s == [RENDERING_S, 2.0 + RENDERING_S]


def test_a_simulation_that_ended_is_said_so(simulation, rig):
    simulation.close()
    with pytest.raises(LinkLost, match="start rig simulate"):
        rig.cameras["front"].grab(5.0)


def test_its_end_wakes_who_waits(simulation):
    waiting = threading.Thread(target=simulation.rig.clock.sleep, args=(3600.0,))
    waiting.start()
    simulation.close()
    waiting.join(10.0)
    assert not waiting.is_alive()


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
        with pytest.raises(Exception, match="expected camera, grab or operator"):
            client.ask(10.0, **request)
        # what is left of the longest
        client.close()
    deep = b"[" * 4000 + b"\n"
    host, port = simulation.addresses["scene"].split(":")
    with socket.create_connection((host, int(port)), 10.0) as raw:
        raw.sendall(deep)
        assert b"RecursionError" in raw.recv(1000)


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


@pytest.mark.parametrize(
    ("line", "answer"),
    [
        ("fault stage.stall", "on: stage.stall"),
        ("fault stage.stal", "fault 'stal': expected one of"),
        ("clear", "on: nothing"),
        ("faults", "on: nothing"),
        ("truth", "time_s: "),
        ("what", "fault DEVICE.FAULT"),
        ("", "fault DEVICE.FAULT"),
    ],
)
def test_what_is_typed_is_answered(simulation, line, answer):
    assert simulation.command(line)[0].startswith(answer)


def test_mistakes_in_its_tables_are_told(log):
    for tables, match in (
        ({"simulation": {"driver": "virtual-rig", "sed": 1}}, "sed: unknown key"),
        ({"cameras": {"front": SMALL | {"width_px": 0}}}, "cameras.front.width_px: "),
        ({"cameras": 3}, "tables"),
        ({"simulation": 3}, 'simulation: a table with driver = "virtual-rig" is expected'),
        ({"simulation": {"driver": "other"}}, 'simulation: a table with driver = "virtual-rig" is expected'),
        ({"stage": 3}, "stage: the address of a simulated device is expected"),
    ):
        with pytest.raises(ConfigurationError, match=match):
            Simulation(tables, "rig.toml", log)
    assert not log.exists()


def test_a_device_that_is_not_simulated_is_refused_for_whoever_uses_the_rig_would_move_it(log):
    stage, frame = TABLES["stage"], TABLES["load_frame"]
    tables = TABLES | {
        "stage": stage | {"port": "/dev/ttyUSB0"},
        "load_frame": frame | {"address": "@frame"},
        "cameras": {"front": {"driver": "v4l2", "device": "/dev/video0"}},
        "operator": {"driver": "console-operator"},
    }
    with pytest.raises(ConfigurationError) as refused:
        Simulation(tables, "rig.toml", log)
    said = "\n".join(refused.value.mistakes)
    assert 'stage: the address of a simulated device is expected, such as "@stage"' in said
    assert "load_frame: '@frame' is none of the simulation's servers: @stage, @newport, " in said
    assert 'cameras.front: a table with driver = "simulated-camera" is expected' in said
    assert 'operator: a table with driver = "simulated-operator" is expected' in said


def test_the_operator_takes_the_time_that_the_rig_file_says(monkeypatch):
    slept: list[float] = []
    monkeypatch.setattr(StoppableClock, "sleep", lambda _, duration_s: slept.append(duration_s))
    tables = TABLES | {"operator": {"driver": "simulated-operator", "duration_s": 3600.0}}
    with closing(Simulation(tables, "rig.toml", None)) as simulation:
        client = SceneClient("operator", simulation.addresses["scene"])
        client.ask(10.0, do="operator", action="ATTACH_GRID")
        client.close()
    assert slept == [3600.0]


def test_servers_are_where_somebody_wants_them(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    link = tmp_path / "stage"
    places = [f"load_frame={port}", f"stage={link}"]
    for _ in range(2):
        simulation = Simulation({}, "rig simulate", None, places)
        try:
            assert simulation.addresses["load_frame"] == f"127.0.0.1:{port}"
            assert simulation.addresses["stage"] == str(link)
            assert stat.S_ISCHR(link.stat().st_mode)
            assert f'port = "{link}"' in simulation.rig_file()
        finally:
            simulation.close()
        assert not link.is_symlink()


@pytest.mark.parametrize("kind", ["port", "scene", "link"])
def test_a_place_that_is_taken_is_refused_and_nothing_is_left_open(kind, tmp_path):
    before = set(threading.enumerate())
    taken = tmp_path / "stage"
    taken.write_text("somebody's")
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        place = {"port": f"load_frame={port}", "scene": f"scene={port}", "link": f"stage={taken}"}[kind]
        with pytest.raises(OSError, match=r"in use|exists"):
            Simulation({}, "rig simulate", None, [place])
    assert set(threading.enumerate()) <= before
    assert taken.read_text() == "somebody's"


def test_a_name_is_not_taken_from_a_simulation_that_runs(tmp_path):
    place = f"stage={tmp_path / 'stage'}"
    simulation = Simulation({}, "rig simulate", None, [place])
    try:
        simulation.switch_on("stage.unplug")
        with pytest.raises(FileExistsError):
            Simulation({}, "rig simulate", None, [place])
    finally:
        simulation.close()
    # what a killed one leaves behind points into a folder that was swept away
    (tmp_path / "stage").symlink_to(tmp_path / "offaxis-pty-1-gone" / "tty")
    Simulation({}, "rig simulate", None, [place]).close()


def test_somebodys_link_is_left_alone_wherever_it_points(tmp_path):
    link = tmp_path / "stage"
    link.symlink_to(tmp_path / "unmounted" / "tty")
    with pytest.raises(FileExistsError):
        Simulation({}, "rig simulate", None, [f"stage={link}"])
    assert link.is_symlink()


@pytest.mark.parametrize(
    "place",
    [
        "",
        "load_frame",
        "load_frame=0",
        "load_frame=65536",
        "load_frame=/tmp/x",
        "stage=",
        "camera=5000",
        "scene=²",
    ],
)
def test_a_place_that_is_none_is_refused(place):
    with pytest.raises(ValueError, match="instead of NAME=PORT"):
        Simulation({}, "rig simulate", None, [place])


def test_one_server_has_one_place():
    with pytest.raises(ValueError, match="a second place for scene"):
        Places.read(["scene=5000", "scene=5001"])


def test_places_are_for_all_servers_there_are(simulation):
    assert sorted(simulation.addresses) == sorted(SERVERS)


def test_the_default_rig_has_everything(log):
    simulation = Simulation({}, "rig simulate", None)
    try:
        assert {"stage", "load_frame", "newport", "load_frame_rtu", "scene"} <= set(simulation.addresses)
        for table in ("[stage]", "[load_frame]", "[cameras.on_axis]", "[cameras.off_axis]", "[operator]"):
            assert table in simulation.rig_file()
    finally:
        simulation.close()
