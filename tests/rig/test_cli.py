"""The commands through their entry point, on the virtual rig with small cameras."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

from rig.cli import main
from tests.places import EXAMPLES

RIG = [sys.executable, "-c", "from rig.cli import main; main()"]


def small_rig(folder: Path, name: str, *edits: tuple[str, str]) -> Path:
    small = 'driver = "simulated-camera"\nwidth_px = 32\nheight_px = 24'
    text = (EXAMPLES / f"rig-virtual-{name}.toml").read_text().replace('driver = "simulated-camera"', small)
    for old, new in edits:
        assert old in text
        text = text.replace(old, new)
    path = folder / "rig.toml"
    path.write_text(text)
    return path


@pytest.fixture
def rig(monkeypatch, capsys):
    def call(*arguments) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["rig", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            main()
        out, err = capsys.readouterr()
        return ended.value.code, out, err

    return call


def test_help_needs_no_heavy_import():
    heavy = (
        "{'numpy', 'h5py', 'pydantic', 'rich', 'scipy', 'numba', 'cv2', 'matplotlib', 'serial', 'pymodbus'}"
    )
    script = f"import sys, rig.cli; print({heavy} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"


def test_tension_runs_from_protocol_to_a_verified_run_file(rig, tmp_path):
    run_file, report = tmp_path / "run.h5", tmp_path / "run.json"
    rig_file = small_rig(tmp_path, "tension")
    status, out, err = rig(
        "run", EXAMPLES / "tension.toml", "--rig", rig_file, "-o", run_file, "--json", report
    )
    assert (status, err) == (0, "")
    table = json.loads(report.read_text())
    assert table["status"] == "completed"
    assert [step["kind"] for step in table["steps"][:3]] == ["grid", "reference", "load"]
    for step in table["steps"]:
        tolerance = {"load": 20.0, "displacement": 0.002}.get(step["kind"])
        if tolerance:
            name = {"load": "load_n", "displacement": "displacement_mm"}[step["kind"]]
            assert step[name] == pytest.approx(step["target"], abs=tolerance)
    assert table["steps"][-1]["target"] == 5.0
    assert out.count("\n") == len(table["steps"]) + 1

    with h5py.File(run_file) as file:
        entry = file["entry"]
        assert entry.attrs["simulated"]
        assert entry["definition"][()].decode() == (EXAMPLES / "tension.toml").read_text()
        assert entry["configuration"][()].decode() == rig_file.read_text()
        images = entry["instrument/off_axis/data"]
        assert images.shape == (len(table["steps"]), 24, 32)
        # Grid and speckle are different pictures, and so is the specimen under load.
        assert not np.array_equal(images[0], images[1])
        assert not np.array_equal(images[1], images[-1])
        series = entry["instrument/load_frame"]
        assert len(series["time_s"]) > 10 * len(table["steps"])
        assert (np.diff(series["time_s"]) >= 0).all()
        assert series["load_n"][()].max() < 13000.0

    status, out, _ = rig("verify", run_file)
    assert status == 0
    assert f"completed, {len(table['steps'])} of 24 planned steps" in out


def test_rotation_runs_and_an_existing_run_file_is_left_alone(rig, tmp_path):
    run_file = tmp_path / "run.h5"
    arguments = (
        "run",
        EXAMPLES / "rotation.toml",
        "--rig",
        small_rig(tmp_path, "rotation-30"),
        "-o",
        run_file,
    )
    assert rig(*arguments)[0] == 0
    with h5py.File(run_file) as file:
        angles_deg = file["entry/steps/angle_deg"][()]
    assert angles_deg == pytest.approx([0.0, *(22.5 * i for i in range(17))], abs=0.01)
    before = run_file.read_bytes()
    status, _, err = rig(*arguments)
    assert status == 2
    assert "never overwritten" in err
    assert run_file.read_bytes() == before


def test_the_same_run_repeats_bit_by_bit(rig, tmp_path):
    table = (EXAMPLES / "rotation.toml").read_text().replace("increment_deg = 22.5", "increment_deg = 120.0")
    (tmp_path / "short.toml").write_text(table)
    rig_file = small_rig(tmp_path, "rotation-30")
    contents = []
    for name in ("a.h5", "b.h5"):
        assert rig("run", tmp_path / "short.toml", "--rig", rig_file, "-o", tmp_path / name)[0] == 0
        with h5py.File(tmp_path / name) as file:
            camera = file["entry/instrument/off_axis"]
            contents.append((camera["data"][()].tobytes(), camera["utc_ns"][()].tobytes()))
    assert contents[0] == contents[1]


def test_plan_refuses_a_rig_that_is_too_weak_and_run_moves_nothing(rig, tmp_path):
    weak = small_rig(tmp_path, "tension", ("load_max_n = 14000.0", "load_max_n = 9000.0"))
    status, out, _ = rig("plan", EXAMPLES / "tension.toml", "--rig", weak)
    assert status == 1
    assert "not on this rig: limits.load_max_n is 13000, but the rig allows 9000 N at most" in out
    status, _, err = rig("run", EXAMPLES / "tension.toml", "--rig", weak, "-o", tmp_path / "run.h5")
    assert status == 2
    assert "allows 9000 N" in err
    assert not (tmp_path / "run.h5").exists()


def test_plan_as_json_is_the_plan_as_printed(rig, tmp_path):
    report = tmp_path / "plan.json"
    rig_file = small_rig(tmp_path, "rotation-10")
    status, out, _ = rig("plan", EXAMPLES / "rotation.toml", "--rig", rig_file, "--json", report)
    table = json.loads(report.read_text())
    assert status == 0
    assert len(table["steps"]) == 18
    assert table["size_bytes"] == 36 * 32 * 24
    assert table["worst_load_n"] is None
    assert "36 images" in out


def test_mistakes_of_protocol_and_rig_file_are_reported_together(rig, tmp_path):
    (tmp_path / "protocol.toml").write_text('kind = "rotation"\n')
    (tmp_path / "rig.toml").write_text('[rig]\nname = "x"\n')
    status, out, err = rig("run", tmp_path / "protocol.toml", "--rig", tmp_path / "rig.toml")
    assert (status, out) == (2, "")
    assert "protocol.toml: sample: is missing" in err
    assert "rig.toml: operator: is missing" in err


@pytest.mark.parametrize("command", ["plan", "check", "verify"])
def test_missing_file_is_one_sentence(rig, tmp_path, command):
    status, out, err = rig(command, tmp_path / "none")
    assert (status, out) == (2, "")
    assert err.startswith("rig: ")
    assert "Traceback" not in err


LONG = {
    "rotation": ("rotation-30", "increment_deg = 22.5", "increment_deg = 0.1"),
    "tension": ("tension", "increment_mm = 0.3", "increment_mm = 0.005"),
}


def long_run(tmp_path: Path, kind: str) -> tuple[Path, subprocess.Popen]:
    rig_name, increment, small_increment = LONG[kind]
    table = (EXAMPLES / f"{kind}.toml").read_text()
    assert increment in table
    (tmp_path / "long.toml").write_text(table.replace(increment, small_increment))
    rig_file, run_file = small_rig(tmp_path, rig_name), tmp_path / "run.h5"
    command = [*RIG, "run", tmp_path / "long.toml", "--rig", rig_file, "-o", run_file]
    child = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    for _ in range(3):
        assert child.stdout.readline().startswith("step")
    return run_file, child


@pytest.mark.parametrize("kind", ["rotation", "tension"])
def test_sigterm_ends_a_run_as_aborted_with_its_steps(rig, tmp_path, kind):
    run_file, child = long_run(tmp_path, kind)
    child.send_signal(signal.SIGTERM)
    out, err = child.communicate(timeout=60)
    assert child.returncode == 1
    assert "got SIGTERM" in err
    assert "SAFE STATE NOT CONFIRMED" not in err
    assert "Traceback" not in err
    assert "aborted: " in out
    status, out, _ = rig("verify", run_file)
    assert status == 1
    assert "the run aborted" in out


def test_killed_run_is_verified_with_its_finished_steps(rig, tmp_path):
    run_file, child = long_run(tmp_path, "rotation")
    child.kill()
    child.communicate(timeout=60)
    report = tmp_path / "verify.json"
    status, out, _ = rig("verify", run_file, "--json", report)
    found = json.loads(report.read_text())
    assert status == 1
    assert "the run is running, or was cut off" in out
    assert found["steps"] >= 3
    assert all(camera["damaged"] == [] for camera in found["cameras"].values())
    assert all(camera["in_steps"] == found["steps"] for camera in found["cameras"].values())


def test_run_goes_on_when_nobody_reads_what_it_prints(rig, tmp_path, monkeypatch):
    reader, writer = os.pipe()
    os.close(reader)
    rig_file = small_rig(tmp_path, "rotation-10")
    with os.fdopen(writer, "w") as stream:
        monkeypatch.setattr(sys, "stdout", stream)
        status, _, err = rig("run", EXAMPLES / "rotation.toml", "--rig", rig_file, "-o", tmp_path / "run.h5")
    assert (status, err) == (0, "")
    with h5py.File(tmp_path / "run.h5") as file:
        assert file["entry/status"][()] == b"completed"


def test_run_is_refused_before_anything_moves_if_its_json_has_no_place(rig, tmp_path):
    rig_file = small_rig(tmp_path, "rotation-10")
    run_file = tmp_path / "run.h5"
    for place, got in ((tmp_path / "none" / "run.json", "no such folder"), (run_file, "one that is read")):
        status, _, err = rig(
            "run", EXAMPLES / "rotation.toml", "--rig", rig_file, "-o", run_file, "--json", place
        )
        assert status == 2
        assert got in err
        assert not run_file.exists()
