"""The simulated rig as another program meets it: through the rig file that it writes."""

import json
import threading
from datetime import datetime, timedelta

import numpy as np
import pytest

from drivers.errors import ConfigurationError, DeviceTimeout, LinkLost
from drivers.interfaces import OpenContext, OperatorAction
from rig.devices import open_rig
from rig.rigfile import read_rig
from simulators.scene_client import CAMERA, SceneClient
from simulators.simulation import Simulation
from simulators.truth_log import TruthLog
from simulators.virtual_rig import VirtualRig, VirtualRigSettings

SMALL = {"driver": "simulated-camera", "width_px": 48, "height_px": 32}
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
    assert rig.cameras["side"].grab(5.0).image.dtype == np.uint16
    rig.operator.perform(OperatorAction.ATTACH_GRID)
    assert simulation.rig.scene.grid_attached
    with_grid = rig.cameras["front"].grab(5.0)
    assert with_grid.sequence == 1
    assert np.any(with_grid.image != frame.image)


def test_a_frame_is_exposed_after_it_was_asked_for(rig):
    asked_s = rig.clock.now_s()
    frame = rig.cameras["front"].grab(5.0)
    assert asked_s <= frame.exposed_s < frame.received_s <= rig.clock.now_s()


def test_the_log_keeps_what_was_true(simulation, rig, log):
    simulation.rig.stage.set_position(0)
    rig.cameras["front"].grab(5.0)
    rig.load_frame.hold()
    simulation.command("fault stage.drop:1")
    simulation.log.sample()
    (frame,) = lines(log, "frame")
    assert (frame["camera"], frame["sequence"], frame["texture"]) == ("front", 0, "Speckle")
    assert frame["deformation_gradient"] == [[1.0, 0.0], [0.0, 1.0]]
    assert [line["command"] for line in lines(log, "command")] == ["hold"]
    assert [line["fault"] for line in lines(log, "fault")] == ["stage.drop:1"]
    (sample,) = lines(log, "sample")
    assert (sample["angle_deg"], sample["load_n"], sample["broken"]) == (0.0, 0.0, False)


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
    with pytest.raises(LinkLost, match=r"cameras.front: grab: expected a camera on its cable"):
        rig.cameras["front"].grab(5.0)
    simulation.command("clear")
    with pytest.raises(DeviceTimeout, match=r"expected a frame within 0\.001 s"):
        rig.cameras["front"].grab(0.001)
    assert rig.cameras["front"].grab(5.0).flags == 0


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
    for request in ({"do": "dance"}, {"do": "grab", "camera": "none", "timeout_s": 1.0}, {"do": "operator"}):
        with pytest.raises(Exception, match="expected camera, grab or operator"):
            client.ask(10.0, **request)
    client.close()


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
        ({"cameras": {"front": SMALL | {"width_px": 0}}}, "cameras.front: 1 mistake"),
        ({"cameras": 3}, "tables"),
    ):
        with pytest.raises(ConfigurationError, match=match):
            Simulation(tables, "rig.toml", log)


def test_the_default_rig_has_everything(log):
    simulation = Simulation({}, "rig simulate", None)
    try:
        assert {"stage", "load_frame", "newport", "load_frame_rtu", "scene"} <= set(simulation.addresses)
        for table in ("[stage]", "[load_frame]", "[cameras.on_axis]", "[cameras.off_axis]", "[operator]"):
            assert table in simulation.rig_file()
    finally:
        simulation.close()
