"""Tests of the program `rig simulate`: start, use through the written rig file, and end."""

import json
import os
import signal
import socket
import sys
from collections.abc import Callable
from contextlib import closing
from functools import partial
from pathlib import Path

import pytest

from rig.devices import open_rig
from rig.rigfile import read_rig
from simulators.rig.scene_client import SceneClient
from tests.command_line import DEADLINE_S, RIG, Program, run_rig
from tests.places import example


@pytest.fixture
def begin(start) -> Callable[..., Program]:
    return partial(start, "simulate")


EXTENDED = pytest.mark.extended


@pytest.mark.parametrize(
    "way", ["SIGTERM", *(pytest.param(way, marks=EXTENDED) for way in ("SIGINT", "SIGHUP", "quit"))]
)
def test_it_ends_at_once_with_status_0(begin, way, tmp_path):
    # an hour between samples must not be waited for
    program = begin("--json", tmp_path / "addresses.json", "--period-s", 3600)
    printed = program.wait_for("scene: ")
    if way != "quit":
        program.process.send_signal(signal.Signals[way])
    assert program.end("quit\n" if way == "quit" else "") == (0, "")
    addresses = json.loads((tmp_path / "addresses.json").read_text())
    assert [f"{name}: {address}" for name, address in addresses.items()] == printed
    assert not Path(addresses["stage"]).exists()


@pytest.mark.extended
def test_another_program_runs_its_rig_and_faults_are_typed_in(begin, tmp_path):
    rig_path, log = tmp_path / "rig.toml", tmp_path / "truth.jsonl"
    program = begin("-o", rig_path, "--log", log, "--fault", "stage.drop:1")
    program.wait_for("scene: ")
    with open_rig(read_rig(rig_path)) as rig:
        rig.load_frame.go_to_displacement(0.02, 1.0)
        program.type("fault load_frame.e-stop\ntruth")
        assert "on: load_frame.e-stop" in program.wait_for("grid_attached: ")
        assert "emergency stop" in rig.load_frame.read().faults
        program.type("clear")
        assert program.wait_for("on: ") == ["on: nothing"]
        rig.stage.stop()
    # at the end of the input it goes on
    program.process.stdin.close()
    program.process.send_signal(signal.SIGINT)
    assert program.process.wait(DEADLINE_S) == 0
    truth = [json.loads(line) for line in log.read_text().splitlines()]
    assert [line["command"] for line in truth if line["what"] == "command"] == ["displacement 0.02 at 1"]
    assert {line["what"] for line in truth} == {"specimen", "sample", "command", "fault"}
    times = [line["time_s"] for line in truth if line["what"] == "sample"]
    assert times == sorted(times)


@pytest.mark.extended
def test_under_nohup_it_outlives_its_terminal(begin):
    ignoring = "import signal; signal.signal(signal.SIGHUP, signal.SIG_IGN); from rig.cli import main; main()"
    program = begin(command=[sys.executable, "-c", ignoring])
    program.wait_for("scene: ")
    program.process.send_signal(signal.SIGHUP)
    program.type("truth")
    program.wait_for("grid_attached: ")
    assert program.end("quit\n") == (0, "")


@pytest.mark.extended
def test_what_was_commanded_last_is_in_the_log(begin, tmp_path):
    rig_path, log = tmp_path / "rig.toml", tmp_path / "truth.jsonl"
    program = begin("-o", rig_path, "--log", log, "--period-s", 3600)
    program.wait_for("scene: ")
    with open_rig(read_rig(rig_path)) as rig:
        rig.load_frame.go_to_displacement(0.02, 1.0)
    program.end("quit\n")
    assert '"command": "displacement 0.02 at 1"' in log.read_text()


@pytest.mark.extended
def test_a_log_that_has_no_more_room_ends_it_in_one_sentence(begin):
    status, complaints = begin("--log", "/dev/full").end()
    assert status == 2
    assert "No space left on device" in complaints
    assert "Traceback" not in complaints


@pytest.mark.extended
def test_in_the_background_of_a_terminal_it_neither_reads_nor_stops(begin, tmp_path):
    ours, theirs = os.openpty()
    # a session whose foreground is this small shell, and the simulation in its background
    shell = (
        "import os, signal, subprocess, sys, fcntl, termios\n"
        "os.setsid()\n"
        "fcntl.ioctl(0, termios.TIOCSCTTY, 0)\n"
        "child = subprocess.Popen(sys.argv[1:], process_group=0)\n"
        "print(child.pid, flush=True)\n"
        "sys.exit(child.wait())\n"
    )
    options = ("--period-s", "0.01", "--json", tmp_path / "json")
    program = begin(*options, command=[sys.executable, "-c", shell, *RIG], stdin=theirs)
    try:
        pid, *lines = program.wait_for("scene: ")
        addresses = dict(line.split(": ") for line in lines)
        # for the shell, not for the simulation
        os.write(ours, b"quit\n")
        with closing(SceneClient("cameras.x", addresses["scene"])) as client:
            for _ in range(3):
                assert client.ask(DEADLINE_S, do="camera", camera="on_axis")[0]["width_px"] == 900
        host, port = addresses["load_frame"].split(":")
        socket.create_connection((host, int(port)), DEADLINE_S).close()
        os.kill(int(pid), signal.SIGTERM)
        assert program.end() == (0, "")
    finally:
        os.close(ours)
        os.close(theirs)


def test_faults_are_listed():
    done = run_rig("simulate", "--list-faults")
    assert done.status == 0
    assert any(line.startswith("drop[:COUNT] ") for line in done.out.splitlines())
    assert any("emergency stop" in line for line in done.out.splitlines())


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--fault", "stage.dorp"), "rig: rig simulate: expected a fault, got fault 'dorp'"),
        (("none.toml",), "none.toml"),
        (("--log", "no/such/folder/log"), "expected a file of its own"),
        (("--at", "camera=5000"), "expected a place, got 'camera=5000' instead of NAME=PORT"),
        (("--at", f"stage={__file__}"), "expected a log that can be written, and places that are free, got "),
        (("typo.toml",), "simulaton: unknown key"),
        (("real.toml",), "stage: the address of a simulated device is expected"),
    ],
)
def test_what_is_wrong_is_one_sentence(options, said, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("typo.toml").write_text('[simulaton]\ndriver = "virtual-rig"\nseed = 3\n')
    Path("real.toml").write_text(example("rig-virtual-rotation-10", ("@stage", "/dev/ttyUSB0")))
    done = run_rig("simulate", *options)
    assert done.status == 2
    assert said in done.err
    assert "Traceback" not in done.err
