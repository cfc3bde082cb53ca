"""Tests of the simulated rig, which another program uses through the written rig file."""

import json
import threading
import tomllib
from contextlib import closing
from datetime import datetime, timedelta

import numpy as np
import pytest

from drivers.clock import SystemClock
from drivers.errors import ConfigurationError
from drivers.interfaces import OpenContext, OperatorAction, OperatorQuestion
from drivers.registry import find_driver
from simulators.rig.scene_client import SceneClient
from simulators.rig.simulation import Simulation, StoppableClock
from simulators.rig.truth_log import TruthLog
from simulators.rig.virtual_rig import VirtualRig, VirtualRigSettings
from tests.simulators.small_rig import SMALL, TABLES


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


def test_the_log_begins_with_the_exact_properties(simulation, log):
    first = json.loads(log.read_text(encoding="utf-8").splitlines()[0])
    assert first["what"] == "specimen"
    assert (first["E_gpa"], first["Rp02_mpa"]) == (73.1, 345.0)


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


def test_its_end_wakes_who_waits(simulation):
    waiting = threading.Thread(target=simulation.rig.clock.sleep, args=(3600.0,))
    waiting.start()
    simulation.close()
    waiting.join(10.0)
    assert not waiting.is_alive()


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


def test_what_the_operator_does_is_said_logged_and_announced(tmp_path):
    said: list[str] = []
    tables = TABLES | {"operator": {"driver": "simulated-operator", "duration_s": 0.0}}
    with closing(Simulation(tables, "rig.toml", tmp_path / "log.jsonl", say=said.append)) as simulation:
        settings = tomllib.loads(simulation.rig_file())["operator"]
        del settings["driver"]
        spec = find_driver("remote-operator")
        operator = spec.open(spec.settings.model_validate(settings), OpenContext("operator", SystemClock()))
        assert operator.notice(OperatorAction.REMOVE_GRID) == (
            "simulated operator: remove the calibration grid, 0 s"
        )
        operator.perform(OperatorAction.REMOVE_GRID)
        question = OperatorQuestion("Please take the extensometer off.", "off")
        told = 'simulated operator: Please take the extensometer off. Answers "off", 0 s'
        assert operator.notice(question) == told
        operator.ask(question)
        operator.close()
    done = "simulated operator: done"
    assert said == ["simulated operator: remove the calibration grid, 0 s", done, told, done]
    actions = [(line["action"], line["done"]) for line in lines(tmp_path / "log.jsonl", "operator")]
    assert actions == [("REMOVE_GRID", False), ("REMOVE_GRID", True), ("ASK", False), ("ASK", True)]


def test_the_default_rig_has_everything(log):
    simulation = Simulation({}, "rig simulate", None)
    try:
        assert {"stage", "load_frame", "newport", "load_frame_rtu", "scene"} <= set(simulation.addresses)
        for table in ("[stage]", "[load_frame]", "[cameras.on_axis]", "[cameras.off_axis]", "[operator]"):
            assert table in simulation.rig_file()
    finally:
        simulation.close()
