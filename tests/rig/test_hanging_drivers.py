"""If a call of a third party's driver never returns, the machine stops and the program ends.

`rig simulate` simulates the machine in a separate program, and its log gives the time of standstill. The long
test requires that at most 1 s passes from the hang to the standstill.
"""

import json
import shutil
import signal
import statistics
from pathlib import Path

import pytest

from dic.runfile.reader import RunFile
from tests.command_line import Program
from tests.places import ROOT, example

pytestmark = pytest.mark.realtime

DRIVERS = ROOT / "tests" / "third_party" / "hanging_drivers"
STANDSTILL_S = 1.0
REPETITIONS = 30
RIG = """
[rig]
name = "rig of a third party"
[simulation]
driver = "virtual-rig"
[stage]
driver = "zaber-ascii"
port = "@stage_tcp"
angle_min_deg = -5.0
angle_max_deg = 365.0
[load_frame]
driver = "modbus-frame"
address = "@load_frame"
load_max_n = 14000.0
displacement_max_mm = 6.0
[cameras.front]
driver = "simulated-camera"
width_px = 48
height_px = 32
[operator]
driver = "simulated-operator"
duration_s = 0.0
"""
QUICK = ("poll_s = 0.2", "poll_s = 0.02")
TURNS = (
    "rotation",
    QUICK,
    ("dwell_s = 0.5", "dwell_s = 0.05"),
    ("increment_deg = 22.5", "increment_deg = 90.0"),
)
PULLS = ("tension", QUICK, ("dwell_s = 1.0", "dwell_s = 0.05"), ("timeout_s = 5.0", "timeout_s = 0.5"))
PROTOCOLS = {"stage": TURNS, "load_frame": PULLS, "cameras.front": PULLS}
DRIVER_OF = {"stage": "zaber-ascii", "load_frame": "modbus-frame", "cameras.front": "remote-camera"}
HANGING = {"stage": "hanging-stage", "load_frame": "hanging-frame", "cameras.front": "hanging-camera"}
MOVED = {"stage": "angle_deg", "load_frame": "displacement_mm"}


@pytest.fixture
def files(tmp_path, monkeypatch) -> Path:
    """A folder with the third party's package, installed so that its entry points are found."""
    metadata = tmp_path / "packages" / "hanging_drivers-1.0.dist-info"
    metadata.mkdir(parents=True)
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: hanging-drivers\nVersion: 1.0\n")
    shutil.copy(DRIVERS / "entry_points.txt", metadata)
    shutil.copy(DRIVERS / "hanging_drivers.py", tmp_path / "packages")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path / "packages"))
    (tmp_path / "rig.toml").write_text(RIG)
    return tmp_path


@pytest.fixture
def simulation(start, files) -> Program:
    begun = start(
        "simulate", files / "rig.toml", "-o", files / "use.toml", "--log", files / "log", "--period-s", 0.01
    )
    begun.wait_for("scene: ")
    return begun


def run(start, files: Path, device: str, hang_in: str, hang_at: int) -> Program:
    """Start a run in which the call number `hang_at` of the method `hang_in` of a device hangs."""
    use = (files / "use.toml").read_text()
    keys = f'hang_in = "{hang_in}"\nhang_at = {hang_at}\nhung = "{files / "hung"}"\n'
    driver = f'driver = "{DRIVER_OF[device]}"\n'
    assert driver in use
    (files / "hanging.toml").write_text(use.replace(driver, f'driver = "{HANGING[device]}"\n{keys}'))
    name, *edits = PROTOCOLS[device]
    (files / "protocol.toml").write_text(example(name, *edits))
    (files / "run.h5").unlink(missing_ok=True)
    return start("run", files / "protocol.toml", "--rig", files / "hanging.toml", "-o", files / "run.h5")


def stood_after_s(files: Path, device: str) -> float:
    """Return the time from the hang to the last motion that the simulation's log shows."""
    lines = [json.loads(line) for line in (files / "log").read_text().splitlines()]
    samples = [line for line in lines if line["what"] == "sample"]
    moved = MOVED[device]
    last = samples[-1][moved]
    moving_s = max(sample["time_s"] for sample in samples if sample[moved] != last)
    return moving_s - float((files / "hung").read_text())


CALLS = [
    ("stage", "read", 100, "stage: read: expected the end of the call within 0.7 s"),
    ("stage", "move_to", 2, "stage: move to 90 deg: expected the end of the call within 0.7 s"),
    ("load_frame", "read", 10, "load_frame: read: expected the end of the call within 0.7 s"),
    ("load_frame", "go_to_load", 1, "load_frame: go to 2000 N: expected the end of the call within 0.7 s"),
]


@pytest.mark.parametrize(
    ("device", "hang_in", "hang_at", "said"), [pytest.param(*CALLS[0], marks=pytest.mark.extended), CALLS[3]]
)
def test_machine_stands_and_the_program_ends_although_a_call_hangs_in_motion(
    simulation, start, files, device, hang_in, hang_at, said
):
    status, complaints = run(start, files, device, hang_in, hang_at).end()
    assert (status, "Traceback" in complaints) == (1, False)
    assert said in complaints
    assert f"rig: {device}: its driver hangs in" in complaints
    assert simulation.end("quit\n") == (0, "")
    with RunFile(files / "run.h5") as written:
        assert written.info.status == "failed"
    print(f"{device}.{hang_in}: stood {stood_after_s(files, device):.2f} s after the hang")


@pytest.mark.extended
def test_program_ends_although_a_camera_hangs(simulation, start, files):
    running = run(start, files, "cameras.front", "grab", 2)
    status, complaints = running.end()
    assert (status, "Traceback" in complaints, "Fatal" in complaints) == (1, False, False)
    assert "cameras.front: grab: expected the end of the call within 2.5 s" in complaints
    assert "rig: cameras.front: its driver hangs in grab" in complaints


@pytest.mark.extended
def test_sigterm_ends_a_run_while_a_call_hangs(simulation, start, files):
    running = run(start, files, "cameras.front", "grab", 3)
    running.wait_for("step 1 ")
    running.process.send_signal(signal.SIGTERM)
    status, complaints = running.end()
    assert (status, "Traceback" in complaints) == (1, False)
    assert "SIGTERM" in complaints
    with RunFile(files / "run.h5") as written:
        assert written.info.status == "aborted"


@pytest.mark.long
@pytest.mark.timeout(1800)
@pytest.mark.parametrize(("device", "hang_in", "hang_at", "said"), CALLS)
def test_machine_stands_within_a_second_of_any_hang(start, files, device, hang_in, hang_at, said):
    after_s = []
    for _ in range(REPETITIONS):
        simulation = start(
            "simulate", files / "rig.toml", "-o", files / "use.toml", "--log", files / "log",
            "--period-s", 0.01, "--force",
        )  # fmt: skip
        simulation.wait_for("scene: ")
        assert said in run(start, files, device, hang_in, hang_at).end()[1]
        simulation.end("quit\n")
        after_s.append(stood_after_s(files, device))
    print(f"{device}.{hang_in}: median {statistics.median(after_s):.3f} s, worst {max(after_s):.3f} s")
    assert max(after_s) <= STANDSTILL_S
