"""A whole experiment in which `rig run` uses the devices that another program, `rig simulate`, simulates."""

import itertools
import json
import math
from pathlib import Path

import pytest

from dic.runfile.reader import RunFile
from tests.command_line import Program

RIG = """
[rig]
name = "small rig"
[simulation]
driver = "virtual-rig"
[stage]
driver = "zaber-ascii"
port = "@stage"
angle_min_deg = -5.0
angle_max_deg = 365.0
speed_deg_s = 20.0
[load_frame]
driver = "modbus-frame"
address = "@load_frame_rtu_tcp"
load_max_n = 14000.0
displacement_max_mm = 6.0
[cameras.front]
driver = "simulated-camera"
width_px = 48
height_px = 32
[cameras.side]
driver = "simulated-camera"
width_px = 48
height_px = 32
pan_deg = 20.0
[operator]
driver = "simulated-operator"
duration_s = 0.0
"""
PROTOCOL = """
kind = "rotation"
title = "two turns"
[sample]
name = "plate"
thickness_mm = 1.0
width_mm = 25.0
gauge_length_mm = 25.0
[rotation]
increment_deg = 5.0
total_deg = 10.0
[settle]
angle_tolerance_deg = 0.01
dwell_s = 0.05
timeout_s = 20.0
poll_s = 0.02
[grid]
lines_x = 21
lines_y = 21
pitch_mm = 0.5
[images]
still = 0
per_step = 1
timeout_s = 5.0
"""


@pytest.fixture
def files(tmp_path) -> Path:
    (tmp_path / "rig.toml").write_text(RIG)
    (tmp_path / "protocol.toml").write_text(PROTOCOL)
    return tmp_path


@pytest.fixture
def simulation(start, files) -> Program:
    place = f"stage={files / 'stage'}"
    begun = start(
        "simulate", files / "rig.toml", "-o", files / "use.toml", "--log", files / "log", "--at", place
    )
    begun.wait_for("scene: ")
    return begun


def run(start, files: Path) -> Program:
    protocol, rig_path = files / "protocol.toml", files / "use.toml"
    return start("run", protocol, "--rig", rig_path, "-o", files / "run.h5", "--json", files / "run.json")


def logged(files: Path, what: str) -> list[dict]:
    lines = map(json.loads, (files / "log").read_text().splitlines())
    return [line for line in lines if line["what"] == what]


@pytest.mark.extended
def test_a_run_measures_what_the_simulation_logs_as_true(simulation, start, files):
    assert run(start, files).end() == (0, "")
    assert simulation.end("quit\n") == (0, "")
    steps = json.loads((files / "run.json").read_text())["steps"]
    assert [(step["kind"], step["angle_deg"]) for step in steps] == [
        ("grid", 0.0),
        ("reference", 0.0),
        ("rotation", pytest.approx(5.0, abs=0.01)),
        ("rotation", pytest.approx(10.0, abs=0.01)),
    ]
    # what the cameras were shown while they exposed is the same surface, turned by the same angles
    for camera in ("front", "side"):
        shown = [frame for frame in logged(files, "frame") if frame["camera"] == camera]
        assert [frame["texture"] for frame in shown] == ["LineGrid", "Speckle", "Speckle", "Speckle"]
        assert [frame["sequence"] for frame in shown] == [0, 1, 2, 3]
        turned = [
            math.degrees(math.atan2(frame["rotation"][1][0], frame["rotation"][0][0])) for frame in shown
        ]
        assert turned == pytest.approx([0.0, 0.0, 5.0, 10.0], abs=0.01)
        assert all(begin["time_s"] < end["time_s"] for begin, end in itertools.pairwise(shown))
    commands = [line["command"] for line in logged(files, "command") if line["device"] == "stage"]
    # 6400 microsteps a degree; each motion once
    assert [each for each in commands if each != "stop"] == ["home", "move 0", "move 32000", "move 64000"]
    with RunFile(files / "run.h5") as written:
        assert (written.info.status, written.info.simulated) == ("completed", True)
        assert written.cameras == ["front", "side"]


@pytest.mark.extended
def test_an_emergency_stop_that_is_typed_in_ends_a_run_in_its_safe_state(simulation, start, files):
    # more steps than can be done before the line is read
    (files / "protocol.toml").write_text(PROTOCOL.replace("total_deg = 10.0", "total_deg = 180.0"))
    running = run(start, files)
    running.wait_for("step 1 ")
    simulation.type("fault stage.e-stop\nfault load_frame.e-stop")
    status, complaints = running.end()
    assert status == 1
    assert "Traceback" not in complaints
    assert complaints.startswith("rig: ")
    assert simulation.end("quit\n") == (0, "")
    with RunFile(files / "run.h5") as written:
        assert written.info.status == "failed"
    pressed_s = logged(files, "fault")[0]["time_s"]
    angles = {sample["angle_deg"] for sample in logged(files, "sample") if sample["time_s"] > pressed_s}
    assert len(angles) == 1
