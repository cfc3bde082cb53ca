"""Tests of `dic process` with complete runs, killed runs, and files that are no runs."""

import csv
import re
import signal
import subprocess
import sys
import threading
from dataclasses import replace

import h5py
import numpy as np
import pytest

from dic.commands.run_table import table
from dic.correlation.settings import CorrelationSettings
from dic.errors import CalibrationError, RunFileError
from dic.out_of_plane.correction import Correction
from dic.pictures.panels import maps_of
from dic.pictures.settings import MapSettings
from dic.pipeline.result_file import load_run_result
from dic.pipeline.result_writer import save_run_result
from dic.pipeline.run import process_run
from dic.report.camera_images import images_of
from dic.report.hardware import hardware_table
from dic.report.stated_facts import StatedFacts
from dic.runfile.reader import RunFile
from rig.run import run_protocol
from tests.command_line import refusal, run_both, run_dic
from tests.places import example, small_cameras
from tests.screens import terminal

BAR = r"correlating [━╸╺ ]+(\d+/\S+)? ?([-\d:]+)?"
"""The progress bar, possibly cut off at its end."""

COARSE = CorrelationSettings(step_px=40)


SMALL = small_cameras(450, 1400.0)
"""A quarter of the pixels of the examples; a point every 40 px is then one of some sixty."""


def short_protocol(folder):
    path = folder / "short.toml"
    path.write_text(example("rotation", ("total_deg = 360.0", "total_deg = 45.0")))
    return path


@pytest.fixture(scope="module")
def run_file(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    path = folder / "run.h5"
    rig = folder / "rig.toml"
    rig.write_text(example("rig-virtual-rotation-30", SMALL))
    assert run_protocol(short_protocol(folder), rig, path).status == "completed"
    return path


@pytest.fixture(scope="module")
def result(run_file):
    return process_run(run_file, COARSE)


def test_a_result_file_gives_back_what_was_measured(result, tmp_path):
    save_run_result(result, tmp_path / "r.h5")
    again = load_run_result(tmp_path / "r.h5")
    assert again.info == result.info
    assert again.settings == result.settings
    assert [c.camera for c in again.cameras] == [c.camera for c in result.cameras]
    for old, new in zip(result.cameras, again.cameras, strict=True):
        np.testing.assert_equal([vars(s) for s in new.steps], [vars(s) for s in old.steps])
        np.testing.assert_array_equal(new.reference, old.reference)
        for a, b in zip(old.measurements, new.measurements, strict=True):
            assert b.summary() == a.summary()
            # Files hold displacements and gradients, without the second derivatives of quadratic subsets.
            np.testing.assert_array_equal(b.field.warps, a.field.warps[..., :6])
            np.testing.assert_array_equal(b.strain.exx, a.strain.exx)


def test_report_reads_the_images_and_the_cameras_of_a_run_from_its_file(result, run_file, tmp_path):
    cameras = images_of(result)
    assert [each.camera for each in cameras] == ["on_axis", "off_axis"]
    rows = dict(hardware_table(result, cameras, StatedFacts()).rows)
    with RunFile(run_file) as run:
        for k, images in enumerate(cameras):
            for place, label in enumerate(images.labels):
                step = next(step for step in run.steps if label == f"{step.kind} {step.index}")
                image = run.image(images.camera, step)
                np.testing.assert_array_equal(images.deformed(place), image)
                height, width = image.shape
            identity = run.identity(images.camera)
            assert rows["Camera"][k].startswith(f"{identity['vendor']}, {identity['model']}")
            assert rows["Image resolution"][k] == f"{width} px × {height} px"
            assert rows["Bit depth"][k] == f"{identity['bits']} bit"
            exposure_us = run.columns(f"instrument/{images.camera}")["exposure_us"][0]
            assert rows["Exposure time"][k] == f"{exposure_us / 1000:g} ms"
            # A camera aside sees more millimetres in one direction than in the other.
            middle, sides = images.calibration.grid.uv_px.mean(axis=0), 10.0 * np.eye(2)
            ends = [images.calibration.map(middle + sign * sides) for sign in (-1.0, 1.0)]
            scales = np.linalg.norm(ends[1] - ends[0], axis=1) / 20.0
            view_mm = [float(rows["Field of view"][k].split()[place]) for place in (0, 3)]
            assert view_mm == pytest.approx(scales * (width, height), rel=1e-3)
    gone = replace(result, source=str(tmp_path / "gone.h5"))
    assert dict(hardware_table(gone, images_of(gone), StatedFacts()).rows)["Camera"] == ["not stated"] * 2
    with pytest.raises(RunFileError, match=r"gone\.h5"):
        images_of(gone)[0].deformed(0)
    assert hardware_table(gone, images_of(gone), StatedFacts()).doubts == []
    broken = tmp_path / "broken.h5"
    broken.write_bytes(run_file.read_bytes()[:5000])
    damaged = replace(result, source=str(broken))
    (doubt,) = hardware_table(damaged, images_of(damaged), StatedFacts()).doubts
    assert doubt.startswith("The run file gives no facts about the cameras, because it cannot be read: ")
    assert str(broken) in doubt
    other = tmp_path / "other.h5"
    other.write_bytes(run_file.read_bytes())
    with h5py.File(other, "r+") as file:
        digests = file["entry/instrument/on_axis/digest"]
        digests[-1] = b"0" * 64
    with pytest.raises(RunFileError, match="expected the image that was measured, got another image"):
        images_of(replace(result, source=str(other)))[0].deformed(1)


def test_the_command_prints_the_table_and_writes_what_it_printed(run_file, tmp_path):
    files = {name: tmp_path / name for name in ("r.h5", "r.json")}
    done = run_dic(
        "process", run_file, "--step", 40, "-o", files["r.h5"], "--json", files["r.json"],
        "--csv", tmp_path / "csv", "--decimal-comma",
    )  # fmt: skip
    assert done.status == 0
    with (tmp_path / "csv" / "strain.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file, delimiter=";"))
    assert len(rows) == 4
    for row in rows:
        steps = done.report["cameras"][row["camera"]]["steps"]
        (step,) = [step for step in steps if f"{step['kind']} {step['index']}" == row["step"]]
        assert float(row["angle_deg"].replace(",", ".")) == pytest.approx(step["angle_deg"], abs=1e-6)
        for kind in ("raw", "calibrated") + (("corrected",) if step["corrected"]["applied"] else ()):
            found = float(row[f"{kind}_exx"].replace(",", "."))
            assert found == pytest.approx(step[kind]["exx"], abs=1e-9)
        name = f"{row['camera']}_{row['step'].replace(' ', '_')}.csv"
        with (tmp_path / "csv" / name).open(encoding="utf-8", newline="") as file:
            points = list(csv.DictReader(file, delimiter=";"))
        assert sum(point["status"] == "converged" for point in points) == int(row["converged"])
        assert ("corrected_exx" in points[0]) == step["corrected"]["applied"]
    assert "SIMULATED" in done.out
    content = done.report
    for camera in ("on_axis", "off_axis"):
        steps = content["cameras"][camera]["steps"]
        assert [round(step["angle_deg"], 1) for step in steps] == [22.5, 45.0]
        assert steps[0]["load_n"] is None
        shown = f"{1e6 * steps[1]['calibrated']['eyy']:8.0f}"
        assert shown in done.out


@pytest.mark.extended
def test_the_report_of_the_command_is_that_of_its_result_file(run_file, tmp_path):
    result, ours, again = (tmp_path / name for name in ("r.h5", "r.html", "again.html"))
    assert run_dic("process", run_file, "--step", 40, "-o", result, "--report", ours).status == 0
    assert run_dic("report", result, "-o", again).status == 0
    assert again.read_bytes() == ours.read_bytes()


@pytest.mark.extended
def test_terminal_shows_the_table_in_100_columns_and_nothing_of_the_bar_is_left(
    run_file, tmp_path, monkeypatch
):
    monkeypatch.setenv("TERM", "xterm")
    with terminal(100) as (stream, watched):
        command = ("dic", "process", run_file, "--step", 40, "-o", tmp_path / "r.h5")
        assert run_both(*command, out=stream, err=stream) == 0
    drawn = {line for screen in watched.seen for line in screen.splitlines() if "correlating" in line}
    assert any("/4" in line for line in drawn)
    assert [line for line in drawn if not re.fullmatch(BAR, line)] == []
    assert "correlating" not in "".join(watched.lines)
    # A row that the terminal had broken would lack strains: exx, eyy and exy.
    rows = [re.split(r" (?:raw|calibrated|corrected) +(?=-?\d)", line) for line in watched.lines]
    strains = [re.findall(r"-?\d+(?:\.\d)?(?: ± [\d.]+)?", row[1]) for row in rows if len(row) == 2]
    # of two cameras in two steps: raw, calibrated and corrected
    assert [len(values) for values in strains] == [3] * 12


@pytest.mark.extended
def test_a_killed_run_is_measured_as_far_as_it_went(tmp_path):
    script = f"""
import os, signal
from pathlib import Path
from rig.recorder import Recorder
from rig.run import run_protocol
def step(self, record, record_step=Recorder.step):
    written = record_step(self, record)
    if record.step.index == 2:
        written.result()
        os.kill(os.getpid(), signal.SIGKILL)
    return written
Recorder.step = step
folder = Path({str(tmp_path)!r})
run_protocol(Path({str(short_protocol(tmp_path))!r}), folder / "rig.toml", folder / "killed.h5")
"""
    (tmp_path / "rig.toml").write_text(example("rig-virtual-rotation-30", SMALL))
    ended = subprocess.run([sys.executable, "-c", script], check=False)
    assert ended.returncode == -signal.SIGKILL
    result = process_run(tmp_path / "killed.h5", COARSE)
    assert result.info.status == "running"
    for camera in result.cameras:
        assert [round(step.angle_deg, 1) for step in camera.steps] == [22.5]


@pytest.mark.parametrize(
    ("content", "word"),
    [(None, "no such file"), (b"not a run", "cut off or is no HDF5")],
    ids=["none", "text"],
)
def test_what_is_no_hdf5_file_is_no_run(tmp_path, content, word):
    if content is not None:
        (tmp_path / "run.h5").write_bytes(content)
    with pytest.raises(RunFileError, match=word):
        RunFile(tmp_path / "run.h5")


@pytest.mark.parametrize("share", [0.05, 0.5, 0.95])
def test_a_run_file_that_was_cut_off_is_refused(run_file, tmp_path, share):
    content = run_file.read_bytes()
    (tmp_path / "cut.h5").write_bytes(content[: int(share * len(content))])
    with pytest.raises(RunFileError, match="cut off"):
        RunFile(tmp_path / "cut.h5")


def test_an_hdf5_file_of_another_kind_is_no_run(tmp_path):
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["x"] = 1
    with pytest.raises(RunFileError, match="another kind"):
        RunFile(tmp_path / "other.h5")


def test_a_run_that_ended_before_the_reference_is_refused(run_file, tmp_path):
    short = tmp_path / "short.h5"
    short.write_bytes(run_file.read_bytes())
    with h5py.File(short, "r+") as file:
        for column in file["entry/steps"].values():
            column.resize((1,))
    with pytest.raises(RunFileError, match="finished reference step"):
        process_run(short)


def test_a_damaged_image_is_named(run_file, tmp_path):
    spoiled = tmp_path / "spoiled.h5"
    spoiled.write_bytes(run_file.read_bytes())
    with h5py.File(spoiled, "r+") as file:
        offset = file["entry/instrument/off_axis/data"].id.get_chunk_info(0).byte_offset
    with spoiled.open("r+b") as raw:
        raw.seek(offset + 1000)
        raw.write(b"\xff\x00\xff\x00")
    with pytest.raises(RunFileError, match="damaged images of off_axis at step 0"):
        process_run(spoiled)


def test_a_run_whose_grid_image_is_no_grid_says_so(run_file, tmp_path):
    spoiled = tmp_path / "no-grid.h5"
    spoiled.write_bytes(run_file.read_bytes())
    with h5py.File(spoiled, "r+") as file:
        camera = file["entry/instrument/off_axis"]
        for name in ("data", "digest"):
            camera[name][0] = camera[name][1]
    with pytest.raises(CalibrationError, match=r"no-grid\.h5: off_axis"):
        process_run(spoiled)


def test_a_result_file_that_is_none_is_refused(run_file, tmp_path):
    for path, word in ((tmp_path / "none.h5", "no such file"), (run_file, "another kind")):
        with pytest.raises(RunFileError, match=word):
            load_run_result(path)


def test_an_interrupt_does_not_wait_for_the_rest_of_the_run(run_file):
    images, expected, interrupted = [], [], threading.Event()

    def interrupt(number, frame):
        interrupted.set()
        raise KeyboardInterrupt

    def on_image(total):
        images.append(1)
        expected.append(total)
        if len(images) == 1:
            signal.pthread_kill(threading.main_thread().ident, signal.SIGINT)
            assert interrupted.wait(60.0)

    before = signal.signal(signal.SIGINT, interrupt)
    try:
        with pytest.raises(KeyboardInterrupt):
            process_run(run_file, COARSE, on_image=on_image)
    finally:
        signal.signal(signal.SIGINT, before)
    assert len(images) < expected[0]


@pytest.mark.long
def test_a_run_takes_new_references_as_it_is_told(run_file, tmp_path):
    command = ("process", run_file, "--step", 40, "-o", tmp_path / "r.h5", "--json", tmp_path / "r.json")
    done = run_dic(*command, "--incremental", "always")
    runs = {
        "never": process_run(run_file, COARSE, incremental="never"),
        "always": load_run_result(tmp_path / "r.h5"),
    }
    for never, always in zip(runs["never"].cameras, runs["always"].cameras, strict=True):
        assert [m.field.updates for m in never.measurements] == [0, 0]
        assert [m.field.updates for m in always.measurements] == [0, 1]
        one, other = never.measurements[1].field, always.measurements[1].field
        both = one.converged & other.converged
        assert both.sum() > 0.9 * one.converged.sum()
        assert np.median(np.hypot(one.u_px - other.u_px, one.v_px - other.v_px)[both]) < 0.05
        # The second reference adds an error like that of the first, in variance.
        first = always.measurements[0].field
        stated = [np.median(np.hypot(f.std_u_px, f.std_v_px)[both & first.converged]) for f in (first, other)]
        assert stated[1] == pytest.approx(np.sqrt(2) * stated[0], rel=0.15)
    assert done.out.count("over 1 new references: std u") == 2
    assert "new references" not in table(runs["never"])
    for camera in done.report["cameras"].values():
        assert [step["updates"] for step in camera["steps"]] == [0, 1]
    assert "auto or never or always, got sometimes" in refusal(*command, "--incremental", "sometimes")


def test_maps_show_corrected_strain_where_there_is_one_and_calibrated_else(result):
    camera = next(camera for camera in result.cameras if camera.camera == "off_axis")
    measurement, correction = camera.measurements[-1], result.corrections.cameras["off_axis"].images[-1]
    assert correction.declined is None
    corrected = maps_of(measurement, MapSettings(), correction).panels
    titles = [panel.title for panel in corrected]
    assert titles[2:] == ["εxx corrected, µε", "εyy corrected, µε", "εxy corrected, µε"]
    # The specimen was turned, not strained; what is calibrated says otherwise.
    (calibrated,) = maps_of(measurement, MapSettings(quantities=("eyy",))).panels
    assert calibrated.title == "εyy calibrated, µε"
    assert abs(np.nanmean(calibrated.values)) > 500
    assert abs(np.nanmean(corrected[3].values)) < 50
    declined = Correction.refused("tilt", measurement, "necking")
    assert maps_of(measurement, MapSettings(), declined).panels[2].title == "εxx calibrated, µε"
