"""The result file of a run is read without any new measurement or correction."""

import json
import re
from collections.abc import Iterator
from dataclasses import replace
from html import unescape
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from dic.commands.run_table import as_dict, table
from dic.correlation.settings import CorrelationSettings
from dic.errors import RunFileError
from dic.pictures.panels import maps_of
from dic.pictures.settings import MapSettings
from dic.pipeline.correction_settings import CorrectionSettings
from dic.pipeline.result import CameraResult, RunResult, correct_run
from dic.pipeline.result_file import load_run_result
from dic.pipeline.result_writer import save_run_result
from dic.runfile.reader import RunStep
from dic.strain.strain import STRAIN_KEYS
from simulators.scene.pose import Pose
from simulators.scene.scene import Misalignment
from tests.dic.out_of_plane.exact_views import State
from tests.dic.pipeline.exact_runs import ASIDE, run_of
from tests.dic.report.page import Page, written
from tests.dic.report.runs import INFO


@pytest.fixture(scope="module")
def tension() -> RunResult:
    """A run in which two cameras correct two steps together; in the third step this fails."""
    steps = [RunStep(2 + k, "load", 1000.0 * k, 1000.0 * k + 1, 0.1 * k, np.nan, 9.0 * k) for k in range(3)]
    F = np.diag([0.999, 1.003])
    states = [State(Pose.sloped(0.05, -0.15, 0.005), F), State(Pose.sloped(0.1, 0.1, 0.02), F)]

    def necking(material_mm: np.ndarray) -> np.ndarray:
        return material_mm * (1.0 + 0.02 * np.exp(-(material_mm[:, 1:] ** 2)))

    return run_of(steps, [*states, State(within=necking)], [*states, State(F=np.diag([1.02, 1.0]))])


@pytest.fixture(scope="module")
def rotation() -> RunResult:
    """A rotation run, from whose false strain the alignment of the stage is solved."""
    stage, angles = Misalignment(axis_slope_x_deg=0.2), [60.0, 120.0, 180.0, 240.0, 300.0]
    steps = [RunStep(2 + k, "rotation", a, np.nan, np.nan, a, 9.0 * k) for k, a in enumerate(angles)]
    states = [State(stage.mounted().after(stage.turned(a))) for a in angles]
    return run_of(steps, states, states)


@pytest.fixture(scope="module")
def results(tension: RunResult, rotation: RunResult) -> dict[str, RunResult]:
    return {"tension": tension, "rotation": rotation}


@pytest.fixture(scope="module")
def files(results: dict[str, RunResult], tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("files")
    for kind, result in results.items():
        save_run_result(result, folder / f"{kind}.h5")
    return {kind: folder / f"{kind}.h5" for kind in results}


def leaves(value: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the path and the value of each element of nested dicts and lists."""
    nested = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, inner in nested:
        yield from leaves(inner, f"{path}/{key}")
    if not isinstance(value, dict | list):
        yield path, value


def figures(result: RunResult) -> tuple[dict[str, Any], dict[str, float]]:
    """Return the values of a run's JSON by their paths: first texts and truth values, then numbers."""
    every = dict(leaves(json.loads(json.dumps(as_dict(result)))))
    numbers = {path: value for path, value in every.items() if isinstance(value, float)}
    return {path: value for path, value in every.items() if path not in numbers}, numbers


def arrays(result: RunResult) -> dict[str, np.ndarray]:
    """Return all arrays of a run's result, by name."""
    found: dict[str, Any] = {}
    for camera in result.cameras:
        found[f"{camera.camera} reference"] = camera.reference
        alignment = result.corrections.cameras[camera.camera].alignment
        found |= {} if alignment is None else {f"{camera.camera} {k}": v for k, v in vars(alignment).items()}
        for k, (step, measurement) in enumerate(zip(camera.steps, camera.measurements, strict=True)):
            name = f"{camera.camera} {step.index}"
            best = result.corrections.best(camera.camera, step.index, k)
            assert measurement.calibrated is not None
            found |= {f"{name} {key}": getattr(measurement.strain, key) for key in STRAIN_KEYS}
            found |= {f"{name} best {key}": getattr(best.strain, key) for key in STRAIN_KEYS}
            found |= {f"{name} warps": measurement.field.warps, f"{name} std": measurement.field.std}
            for where, displacement in (("raw", measurement.raw), ("", measurement.calibrated)):
                found[f"{name} {where} position"] = displacement.position
                found[f"{name} {where} vector"] = displacement.vector
                found[f"{name} {where} valid"] = displacement.valid
            found[f"{name} best vector"] = best.displacement.vector
    if result.corrections.joint is not None:
        for index, both in result.corrections.joint.steps.items():
            if both.mean is not None:
                found |= {f"{index} heights": both.heights_mm, f"{index} heights std": both.heights_std_mm}
                found |= {f"{index} {k}": list(vars(c.mean).values()) for k, c in enumerate(both.corrections)}
    return found


def assert_equal(one: RunResult, other: RunResult) -> None:
    assert figures(one)[0] == figures(other)[0]
    assert figures(one)[1] == pytest.approx(figures(other)[1], rel=1e-12, abs=0.0)
    ours, theirs = arrays(one), arrays(other)
    assert ours.keys() == theirs.keys()
    for name, values in theirs.items():
        np.testing.assert_allclose(ours[name], values, rtol=1e-12, err_msg=name)


def test_runs_of_these_tests_hold_all_that_a_run_may_hold(results: dict[str, RunResult]) -> None:
    corrections = results["tension"].corrections
    assert corrections.joint is not None
    assert [step.declined is None for step in corrections.joint.steps.values()] == [True, True, False]
    assert corrections.joint.findings
    assert results["rotation"].corrections.cameras["aside"].alignment is not None


@pytest.mark.parametrize("kind", ["tension", "rotation"])
def test_what_was_saved_is_loaded(kind: str, results: dict[str, RunResult], files: dict[str, Path]) -> None:
    result, again = results[kind], load_run_result(files[kind])
    assert_equal(again, result)
    assert (again.info, again.source, again.settings) == (result.info, result.source, result.settings)
    assert again.correcting == result.correcting
    assert table(again) == table(result)


@pytest.mark.parametrize("kind", ["tension", pytest.param("rotation", marks=pytest.mark.long)])
def test_loaded_run_is_saved_as_the_same_file(kind: str, files: dict[str, Path], tmp_path: Path) -> None:
    again = load_run_result(files[kind])
    save_run_result(again, tmp_path / "again.h5")
    assert_equal(load_run_result(tmp_path / "again.h5"), again)


@pytest.mark.extended
@pytest.mark.parametrize("kind", ["tension", pytest.param("rotation", marks=pytest.mark.long)])
def test_reading_and_reporting_measure_and_correct_nothing(
    kind: str,
    results: dict[str, RunResult],
    files: dict[str, Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    origin = load_run_result(files[kind]).provenance
    assert origin is not None
    expected = written(tmp_path, replace(results[kind], provenance=origin))
    assert origin.command in unescape(expected)

    def forbidden(*_: Any, **__: Any) -> None:
        raise AssertionError("solved again")

    for name in (
        "dic.correlation.correlator.Correlator.correlate",
        "dic.correlation.series.Series.correlate",
        "dic.calibration.calibration.Calibration.fit",
        "dic.strain.measurement.mean_strain",
        "dic.strain.measurement.strain_field",
        "dic.strain.measurement.calibrated_displacement",
        "dic.out_of_plane.correction.strain_field",
        "dic.results.reader.measure",
        "dic.pipeline.result_file.correct_run",
        "dic.pipeline.corrections.correct",
        "dic.pipeline.corrections.correct_with_two_cameras",
    ):
        monkeypatch.setattr(name, forbidden)
    assert written(tmp_path, load_run_result(files[kind])) == expected


class TestTamperedFile:
    """A value that was changed in the result file appears in all outputs."""

    STRAIN = 0.0123456

    @pytest.fixture
    def tampered(self, files: dict[str, Path], tmp_path: Path) -> Path:
        path = tmp_path / "tampered.h5"
        path.write_bytes(files["tension"].read_bytes())
        with h5py.File(path, "r+") as file:
            series, both = file["cameras/aside/series"], file["both"]
            series["raw_mean/exx"][0] = self.STRAIN
            series["calibrated_mean/eyy"][0] = 2 * self.STRAIN
            series["corrected_mean/exy"][0] = 3 * self.STRAIN
            series["corrected_mean/exy_std"][0] = 0.004
            both["mean/eyy"][0] = 4 * self.STRAIN
            series["exx"][2] = 5 * self.STRAIN
            both["aside/corrected/exx"][1] = 6 * self.STRAIN
            both["findings"][0] = "somebody was here"
        return path

    def test_means_in_the_result_and_for_programs(self, tampered: Path) -> None:
        found = as_dict(load_run_result(tampered))
        step = found["cameras"]["aside"]["steps"][0]
        assert step["raw"]["exx"] == self.STRAIN
        assert step["calibrated"]["eyy"] == 2 * self.STRAIN
        assert step["corrected"]["exy"] == 3 * self.STRAIN
        assert step["corrected"]["exy_std"] == 0.004
        assert found["both"]["steps"][0]["eyy"] == 4 * self.STRAIN

    def test_means_in_the_table(self, tampered: Path) -> None:
        lines = table(load_run_result(tampered)).splitlines()
        first = next(number for number, line in enumerate(lines) if "load 2" in line)
        rows = {"raw": 12346, "calibrated": 24691, "corrected": 37037}
        for line, (kind, strain) in zip(lines[first:], rows.items(), strict=False):
            assert kind in line
            assert re.search(rf" {strain}(\.\d)?\b", line), line
        together = [line for line in lines if "load 2" in line and "corrected" in line]
        assert any(re.search(r" 49382(\.\d)? ±", line) for line in together)
        assert "  somebody was here" in lines

    def test_means_in_the_report(self, tampered: Path, tmp_path: Path) -> None:
        page = Page(written(tmp_path, load_run_result(tampered), fields=False, drawn=False))
        rows = [row for kind in ("steps", "steps together") for t in page.all_tables(kind) for row in t]
        cells = {cell for row in rows for cell in row}
        assert {"12 346", "37 037 ± 4000"} <= cells
        for strain in ("24 691 ± ", "49 382.4 ± "):
            assert any(cell.startswith(strain) for cell in cells)
        assert "Somebody was here." in page.text

    def test_local_strain_in_the_maps(self, tampered: Path) -> None:
        result = load_run_result(tampered)
        aside = next(camera for camera in result.cameras if camera.camera == "aside")
        for k, expected in ((2, 5 * self.STRAIN), (1, 6 * self.STRAIN)):
            best = result.corrections.best("aside", aside.steps[k].index, k)
            (exx,) = maps_of(aside.measurements[k], MapSettings(quantities=("exx",)), best).panels
            np.testing.assert_allclose(exx.values, 1e6 * expected)


class TestFileWrittenBefore:
    """Result files of earlier versions, without points, rotations, findings, alignments, corrected fields."""

    @pytest.fixture(params=[pytest.param("tension", marks=pytest.mark.extended), "rotation"])
    def kind(self, request: pytest.FixtureRequest) -> str:
        return str(request.param)

    @pytest.fixture
    def older(self, kind: str, files: dict[str, Path], tmp_path: Path) -> Path:
        path = tmp_path / "older.h5"
        path.write_bytes(files[kind].read_bytes())
        with h5py.File(path, "r+") as file:
            del file["run"].attrs["motion"]
            for name in [*(["both"] if "both" in file else [])]:
                del file[name]
            for camera in file["cameras"].values():
                for name in ("findings", "alignment", "series/corrected"):
                    if name in camera:
                        del camera[name]
                for mean in ("raw_mean", "calibrated_mean", "corrected_mean"):
                    for name in ("points", "rotation_deg"):
                        del camera[f"series/{mean}/{name}"]
        return path

    def test_is_read_with_equal_numbers(self, kind: str, older: Path, results: dict[str, RunResult]) -> None:
        assert_equal(load_run_result(older), results[kind])

    @pytest.mark.extended
    def test_keeps_what_stands_in_it(self, older: Path) -> None:
        with h5py.File(older, "r+") as file:
            series = file["cameras/straight/series"]
            for k, name in enumerate(("raw_mean/exx", "calibrated_mean/exx", "corrected_mean/exx"), 1):
                series[name][0] = 0.001 * k
            series["exx"][0] = 0.007
        result = load_run_result(older)
        step = as_dict(result)["cameras"]["straight"]["steps"][0]
        assert [step[mean]["exx"] for mean in ("raw", "calibrated", "corrected")] == [0.001, 0.002, 0.003]
        straight = next(camera for camera in result.cameras if camera.camera == "straight")
        assert (straight.measurements[0].strain.exx == 0.007).all()


def test_run_in_which_nothing_was_measured_is_saved_and_loaded(tmp_path: Path) -> None:
    camera = CameraResult(
        "aside", ASIDE.calibration(), np.zeros((800, 800), np.float32), [], [], ["step 2: dark"]
    )
    corrections = correct_run([camera], CorrectionSettings())
    result = RunResult("run.h5", INFO, CorrelationSettings(), CorrectionSettings(), [camera], corrections)
    save_run_result(result, tmp_path / "r.h5")
    assert figures(load_run_result(tmp_path / "r.h5")) == figures(result)


def test_file_that_lacks_a_strain_is_refused_in_one_sentence(files: dict[str, Path], tmp_path: Path) -> None:
    path = tmp_path / "cut.h5"
    path.write_bytes(files["tension"].read_bytes())
    with h5py.File(path, "r+") as file:
        del file["cameras/aside/series/eyy_std"]
    with pytest.raises(RunFileError, match="lacks some of its data"):
        load_run_result(path)


def test_file_of_a_newer_version_is_refused_in_one_sentence(files: dict[str, Path], tmp_path: Path) -> None:
    path = tmp_path / "newer.h5"
    path.write_bytes(files["tension"].read_bytes())
    with h5py.File(path, "r+") as file:
        file.attrs["file_format_version"] = 2
    with pytest.raises(
        RunFileError,
        match=r"format 1 .*, which offaxis [\d.]+ reads, got format 2, written by .*; read it with",
    ):
        load_run_result(path)


def test_every_number_in_the_file_has_units(files: dict[str, Path]) -> None:
    for path in files.values():
        with h5py.File(path) as file:
            bare: list[str] = []

            def check(name: str, item: Any, bare: list[str] = bare) -> None:
                if isinstance(item, h5py.Dataset) and item.dtype.kind != "O" and "units" not in item.attrs:
                    bare.append(name)

            file.visititems(check)
            assert bare == []
