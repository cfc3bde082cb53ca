"""Tests of the commands of `rig` through their entry point, on the virtual rig with small cameras."""

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from tests.command_line import Program, run_rig
from tests.places import EXAMPLES, example

CAMERA = 'driver = "simulated-camera"'


def small_rig(folder: Path, name: str, *edits: tuple[str, str]) -> Path:
    path = folder / "rig.toml"
    path.write_text(
        example(f"rig-virtual-{name}", (CAMERA, f"{CAMERA}\nwidth_px = 32\nheight_px = 24"), *edits)
    )
    return path


def test_help_needs_no_heavy_import():
    heavy = (
        "{'numpy', 'h5py', 'pydantic', 'rich', 'scipy', 'numba', 'cv2', 'matplotlib', 'serial', 'pymodbus'}"
    )
    script = f"import sys, rig.cli; print({heavy} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"


@pytest.mark.extended
def test_tension_runs_from_protocol_to_a_verified_run_file(tmp_path):
    run_file, report = tmp_path / "run.h5", tmp_path / "run.json"
    rig_file = small_rig(tmp_path, "tension")
    done = run_rig("run", EXAMPLES / "tension.toml", "--rig", rig_file, "-o", run_file, "--json", report)
    assert (done.status, done.err) == (0, "")
    table = done.report
    assert table["status"] == "completed"
    kinds = [step["kind"] for step in table["steps"][:5]]
    assert kinds == ["grid", "reference", "static", "static", "load"]
    for step in table["steps"]:
        tolerance = {"load": 20.0, "displacement": 0.002}.get(step["kind"])
        if tolerance:
            name = {"load": "load_n", "displacement": "displacement_mm"}[step["kind"]]
            assert step[name] == pytest.approx(step["target"], abs=tolerance)
    assert table["steps"][-1]["target"] == 5.0
    assert done.out.count("\n") == len(table["steps"]) + 2

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

    done = run_rig("verify", run_file)
    assert done.status == 0
    assert f"completed, {len(table['steps'])} of 26 planned steps" in done.out


def test_rotation_runs_and_an_existing_run_file_is_left_alone(tmp_path):
    run_file = tmp_path / "run.h5"
    arguments = (
        "run",
        EXAMPLES / "rotation.toml",
        "--rig",
        small_rig(tmp_path, "rotation-30"),
        "-o",
        run_file,
    )
    assert run_rig(*arguments).status == 0
    with h5py.File(run_file) as file:
        angles_deg = file["entry/steps/angle_deg"][()]
    assert angles_deg == pytest.approx([0.0, 0.0, 0.0, *(22.5 * i for i in range(17))], abs=0.01)
    before = run_file.read_bytes()
    done = run_rig(*arguments)
    assert done.status == 2
    assert "never overwritten" in done.err
    assert run_file.read_bytes() == before


@pytest.mark.extended
def test_the_same_run_repeats_bit_by_bit(tmp_path):
    short = example("rotation", ("increment_deg = 22.5", "increment_deg = 120.0"))
    (tmp_path / "short.toml").write_text(short)
    rig_file = small_rig(tmp_path, "rotation-30")
    contents = []
    for name in ("a.h5", "b.h5"):
        assert run_rig("run", tmp_path / "short.toml", "--rig", rig_file, "-o", tmp_path / name).status == 0
        with h5py.File(tmp_path / name) as file:
            camera = file["entry/instrument/off_axis"]
            contents.append((camera["data"][()].tobytes(), camera["utc_ns"][()].tobytes()))
    assert contents[0] == contents[1]


def test_plan_refuses_a_rig_that_is_too_weak_and_run_moves_nothing(tmp_path):
    weak = small_rig(tmp_path, "tension", ("load_max_n = 14000.0", "load_max_n = 9000.0"))
    done = run_rig("plan", EXAMPLES / "tension.toml", "--rig", weak)
    assert done.status == 1
    assert "not on this rig: limits.load_max_n is 13000, but the rig allows 9000 N at most" in done.out
    done = run_rig("run", EXAMPLES / "tension.toml", "--rig", weak, "-o", tmp_path / "run.h5")
    assert done.status == 2
    assert "allows 9000 N" in done.err
    assert not (tmp_path / "run.h5").exists()


def test_plan_as_json_is_the_plan_as_printed(tmp_path):
    report = tmp_path / "plan.json"
    rig_file = small_rig(tmp_path, "rotation-10")
    done = run_rig("plan", EXAMPLES / "rotation.toml", "--rig", rig_file, "--json", report)
    table = done.report
    assert done.status == 0
    assert len(table["steps"]) == 20
    assert table["size_bytes"] == 40 * 32 * 24
    assert table["worst_load_n"] is None
    assert "40 images" in done.out


def test_mistakes_of_protocol_and_rig_file_are_reported_together(tmp_path):
    (tmp_path / "protocol.toml").write_text('kind = "rotation"\n')
    (tmp_path / "rig.toml").write_text('[rig]\nname = "x"\n')
    done = run_rig("run", tmp_path / "protocol.toml", "--rig", tmp_path / "rig.toml")
    assert (done.status, done.out) == (2, "")
    assert "protocol.toml: sample: is missing" in done.err
    assert "rig.toml: operator: is missing" in done.err


@pytest.mark.parametrize("command", ["plan", "check", "verify"])
def test_missing_file_is_one_sentence(tmp_path, command):
    done = run_rig(command, tmp_path / "none")
    assert (done.status, done.out) == (2, "")
    assert done.err.startswith("rig: ")
    assert "Traceback" not in done.err


LONG = {
    "rotation": ("rotation-30", "increment_deg = 22.5", "increment_deg = 0.1"),
    "tension": ("tension", "increment_mm = 0.3", "increment_mm = 0.005"),
}


def long_run(start: Callable[..., Program], tmp_path: Path, kind: str) -> tuple[Path, Program]:
    rig_name, *increment = LONG[kind]
    (tmp_path / "long.toml").write_text(example(kind, tuple(increment)))
    rig_file, run_file = small_rig(tmp_path, rig_name), tmp_path / "run.h5"
    program = start("run", tmp_path / "long.toml", "--rig", rig_file, "-o", run_file)
    for _ in range(3):
        program.wait_for("step")
    return run_file, program


@pytest.mark.parametrize("kind", ["rotation", pytest.param("tension", marks=pytest.mark.extended)])
def test_sigterm_ends_a_run_as_aborted_with_its_steps(start, tmp_path, kind):
    run_file, program = long_run(start, tmp_path, kind)
    program.process.send_signal(signal.SIGTERM)
    program.wait_for("aborted: ")
    status, complaints = program.end()
    assert status == 1
    assert "got SIGTERM" in complaints
    assert "SAFE STATE NOT CONFIRMED" not in complaints
    assert "Traceback" not in complaints
    verified = run_rig("verify", run_file)
    assert verified.status == 1
    assert "the run aborted" in verified.out


@pytest.mark.extended
def test_killed_run_is_verified_with_its_finished_steps(start, tmp_path):
    run_file, program = long_run(start, tmp_path, "rotation")
    program.process.kill()
    program.end()
    done = run_rig("verify", run_file, "--json", tmp_path / "verify.json")
    found = done.report
    assert done.status == 1
    assert "the run is running, or was cut off" in done.out
    assert found["steps"] >= 3
    assert all(camera["damaged"] == [] for camera in found["cameras"].values())
    assert all(camera["in_steps"] == found["steps"] for camera in found["cameras"].values())


def test_run_goes_on_when_nobody_reads_what_it_prints(tmp_path):
    reader, writer = os.pipe()
    os.close(reader)
    rig_file = small_rig(tmp_path, "rotation-10")
    with os.fdopen(writer, "w") as stream:
        arguments = ("run", EXAMPLES / "rotation.toml", "--rig", rig_file, "-o", tmp_path / "run.h5")
        done = run_rig(*arguments, out=stream)
    assert (done.status, done.err) == (0, "")
    with h5py.File(tmp_path / "run.h5") as file:
        assert file["entry/status"][()] == b"completed"


def test_run_is_refused_before_anything_moves_if_its_json_has_no_place(tmp_path):
    rig_file = small_rig(tmp_path, "rotation-10")
    run_file = tmp_path / "run.h5"
    for place, got in ((tmp_path / "none" / "run.json", "no such folder"), (run_file, "one that is read")):
        done = run_rig("run", EXAMPLES / "rotation.toml", "--rig", rig_file, "-o", run_file, "--json", place)
        assert done.status == 2
        assert got in done.err
        assert not run_file.exists()
