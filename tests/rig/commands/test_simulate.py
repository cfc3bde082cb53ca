"""`rig simulate` as a program: started, used through its rig file, and ended."""

import json
import os
import signal
import socket
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import pytest

from rig.cli import main
from rig.devices import open_rig
from rig.rigfile import read_rig
from simulators.rig.scene_client import SceneClient
from tests.places import EXAMPLES

COMMAND = [sys.executable, "-c", "from rig.cli import main; main()", "simulate"]
DEADLINE_S = 60


def begin(*options: str, command: list[str] = COMMAND) -> subprocess.Popen:
    return subprocess.Popen(
        [*command, *options],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        bufsize=1,
    )


def lines_until(process: subprocess.Popen, beginning: str) -> list[str]:
    """Read what is printed up to a line that begins so."""
    lines = []
    for line in process.stdout:
        lines.append(line.strip())
        if line.startswith(beginning):
            return lines
    raise AssertionError(f"{lines}, {process.stderr.read()}")


@pytest.mark.parametrize("way", ["SIGINT", "SIGTERM", "SIGHUP", "quit"])
def test_it_ends_at_once_with_status_0(way, tmp_path):
    # an hour between samples must not be waited for
    process = begin("--json", str(tmp_path / "addresses.json"), "--period-s", "3600")
    printed = lines_until(process, "scene: ")
    if way == "quit":
        process.stdin.write("quit\n")
    else:
        process.send_signal(signal.Signals[way])
    _, complaints = process.communicate(timeout=DEADLINE_S)
    assert (process.returncode, complaints) == (0, "")
    addresses = json.loads((tmp_path / "addresses.json").read_text())
    assert [f"{name}: {address}" for name, address in addresses.items()] == printed
    assert not Path(addresses["stage"]).exists()


def test_another_program_runs_its_rig_and_faults_are_typed_in(tmp_path):
    rig_path, log = tmp_path / "rig.toml", tmp_path / "truth.jsonl"
    process = begin("-o", str(rig_path), "--log", str(log), "--fault", "stage.drop:1")
    try:
        lines_until(process, "scene: ")
        with open_rig(read_rig(rig_path)) as rig:
            rig.load_frame.go_to_displacement(0.02, 1.0)
            process.stdin.write("fault load_frame.e-stop\ntruth\n")
            assert "on: load_frame.e-stop" in lines_until(process, "grid_attached: ")
            assert "emergency stop" in rig.load_frame.read().faults
            process.stdin.write("clear\n")
            assert lines_until(process, "on: ") == ["on: nothing"]
            rig.stage.stop()
        # at the end of the input it goes on
        process.stdin.close()
        process.send_signal(signal.SIGINT)
        assert process.wait(DEADLINE_S) == 0
    finally:
        process.kill()
        process.stdout.close()
        process.stderr.close()
        process.wait()
    truth = [json.loads(line) for line in log.read_text().splitlines()]
    assert [line["command"] for line in truth if line["what"] == "command"] == ["displacement 0.02 at 1"]
    assert {line["what"] for line in truth} == {"sample", "command", "fault"}
    times = [line["time_s"] for line in truth if line["what"] == "sample"]
    assert times == sorted(times)


def test_under_nohup_it_outlives_its_terminal():
    ignoring = "import signal; signal.signal(signal.SIGHUP, signal.SIG_IGN); from rig.cli import main; main()"
    process = begin(command=[sys.executable, "-c", ignoring, "simulate"])
    lines_until(process, "scene: ")
    process.send_signal(signal.SIGHUP)
    process.stdin.write("truth\n")
    lines_until(process, "grid_attached: ")
    _, complaints = process.communicate("quit\n", timeout=DEADLINE_S)
    assert (process.returncode, complaints) == (0, "")


def test_what_was_commanded_last_is_in_the_log(tmp_path):
    rig_path, log = tmp_path / "rig.toml", tmp_path / "truth.jsonl"
    process = begin("-o", str(rig_path), "--log", str(log), "--period-s", "3600")
    lines_until(process, "scene: ")
    with open_rig(read_rig(rig_path)) as rig:
        rig.load_frame.go_to_displacement(0.02, 1.0)
    process.communicate("quit\n", timeout=DEADLINE_S)
    assert '"command": "displacement 0.02 at 1"' in log.read_text()


def test_a_log_that_has_no_more_room_ends_it_in_one_sentence():
    process = begin("--log", "/dev/full")
    _, complaints = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 2
    assert "No space left on device" in complaints
    assert "Traceback" not in complaints


def test_in_the_background_of_a_terminal_it_neither_reads_nor_stops(tmp_path):
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
    process = subprocess.Popen(
        [sys.executable, "-c", shell, *COMMAND, "--period-s", "0.01", "--json", str(tmp_path / "json")],
        stdin=theirs,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        pid, *lines = lines_until(process, "scene: ")
        addresses = dict(line.split(": ") for line in lines)
        # for the shell, not for the simulation
        os.write(ours, b"quit\n")
        with closing(SceneClient("cameras.x", addresses["scene"])) as client:
            for _ in range(3):
                assert client.ask(DEADLINE_S, do="camera", camera="on_axis")[0]["width_px"] == 900
        host, port = addresses["load_frame"].split(":")
        socket.create_connection((host, int(port)), DEADLINE_S).close()
        os.kill(int(pid), signal.SIGTERM)
        _, complaints = process.communicate(timeout=DEADLINE_S)
    finally:
        os.close(ours)
        os.close(theirs)
    assert (process.returncode, complaints) == (0, "")


@pytest.fixture
def simulate(monkeypatch, capsys):
    def call(*options: str) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["rig", "simulate", *options])
        with pytest.raises(SystemExit) as ended:
            main()
        printed, complaints = capsys.readouterr()
        return ended.value.code, printed, complaints

    return call


def test_faults_are_listed(simulate):
    status, printed, _ = simulate("--list-faults")
    assert status == 0
    assert any(line.startswith("drop[:COUNT] ") for line in printed.splitlines())
    assert any("emergency stop" in line for line in printed.splitlines())


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
def test_what_is_wrong_is_one_sentence(simulate, options, said, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("typo.toml").write_text('[simulaton]\ndriver = "virtual-rig"\nseed = 3\n')
    example = (EXAMPLES / "rig-virtual-rotation-10.toml").read_text()
    Path("real.toml").write_text(example.replace("@stage", "/dev/ttyUSB0"))
    status, _, complaints = simulate(*options)
    assert status == 2
    assert said in complaints
    assert "Traceback" not in complaints
