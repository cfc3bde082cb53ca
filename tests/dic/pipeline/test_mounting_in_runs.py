"""`dic process` uses the mounting in the run file, for rendered images of a specimen behind a plate."""

import h5py
import numpy as np
import pytest

from dic.correlation.settings import CorrelationSettings
from dic.errors import CalibrationError, RunFileError
from dic.pipeline.correction_settings import CorrectionSettings
from dic.pipeline.run import process_run
from dic.specimen.find import SpecimenNotFound
from simulators.scene.pose import Pose
from tests.command_line import run_dic
from tests.dic.pipeline.rendered_run import slid, write_rendered_run

pytestmark = pytest.mark.usefixtures("grids_found_once")
PLATE_MM, SLIDE_MM = 1.0, 0.3
COARSE = CorrelationSettings(step_px=30, shape="quadratic")


@pytest.fixture(scope="module")
def run_file(tmp_path_factory):
    """The run file of a specimen that slides in its plane, 1 mm behind the grid's lines."""
    return write_rendered_run(
        tmp_path_factory.mktemp("run") / "run.h5",
        [slid(SLIDE_MM)],
        grid_pose=Pose.sloped(0.0, 0.0, PLATE_MM),
        plate_mm=PLATE_MM,
        tilt_axis_mm=[0.0, -30.0],
        shift_std_um=3.0,
        fixed_face="back",
    )


def slide_mm(result):
    (measurement,) = result.cameras[0].measurements
    calibrated = measurement.calibrated
    return calibrated.vector[calibrated.valid].mean(axis=0)


@pytest.fixture(scope="module")
def result(run_file):
    return process_run(run_file, COARSE)


def test_the_series_of_a_camera_is_chosen_by_its_name(result):
    assert [image.label for image in result.series("aside").images] == ["step 2"]
    with pytest.raises(RunFileError, match=r"choose a camera: expected .*aside.*, got above"):
        result.series("above")


def test_the_plate_of_the_run_file_is_taken_out_of_the_scale(run_file, result):
    assert result.cameras[0].calibration.plate_mm == PLATE_MM
    np.testing.assert_allclose(slide_mm(result), [0.0, SLIDE_MM], atol=0.0005)
    without = slide_mm(process_run(run_file, COARSE, plate_mm=0.0))
    # The lines are nearer to the camera by 1 mm of 34.64 mm.
    share = 1.0 - PLATE_MM / (40.0 * np.cos(np.radians(30.0)))
    np.testing.assert_allclose(without, [0.0, share * SLIDE_MM], atol=0.0005)


def test_shift_and_hinge_of_the_run_file_are_taken_unless_they_are_given(run_file, result):
    assert result.correcting == CorrectionSettings(
        shift_std_um=3.0, tilt_axis_mm=(0.0, -30.0), thickness_mm=1.0, fixed_face="back"
    )
    given = CorrectionSettings(0.33, {}, 9.0, (0.0, 50.0), 2.0, "middle")
    assert process_run(run_file, COARSE, correcting=given).correcting == given


def test_the_command_line_replaces_the_plate_and_tells_it(run_file, tmp_path):
    options = ("--step", 30, "-o", tmp_path / "r.h5", "--json", tmp_path / "r.json")
    done = run_dic("process", run_file, *options, "--plate-mm", 0.5, "--tilt-axis-mm", "1,-20")
    assert "surface 0.5 mm behind the lines" in done.out
    assert done.report["cameras"]["aside"]["calibration"]["plate_mm"] == 0.5
    assert done.report["shift"] == {
        "shift_std_um": 3.0,
        "tilt_axis_mm": [1.0, -20.0],
        "thickness_mm": 1.0,
        "fixed_face": "back",
    }


def test_a_run_whose_specimen_is_not_found_is_measured_in_the_calibrated_area(
    run_file, result, tmp_path, monkeypatch
):
    def refuse(*_, **__):
        raise SpecimenNotFound("reference image", "find the specimen", "a surface", "none", "name the region")

    monkeypatch.setattr("dic.correlation.correlator.find_specimen", refuse)
    done = run_dic("process", run_file, "--step", 30, "-o", tmp_path / "r.h5")
    assert "aside: no specimen was found by its speckles; points cover the calibrated area" in done.out
    assert done.status == 0


def test_a_plate_that_cannot_be_is_refused(run_file):
    with pytest.raises(CalibrationError, match="or 0 for none"):
        process_run(run_file, COARSE, plate_mm=30.0)


def test_a_run_file_of_an_earlier_program_declares_nothing(run_file, tmp_path):
    older = tmp_path / "older.h5"
    older.write_bytes(run_file.read_bytes())
    with h5py.File(older, "a") as file:
        del file["entry/mounting"]
    found = process_run(older, COARSE)
    assert found.cameras[0].calibration.plate_mm == 0.0
    assert found.correcting == CorrectionSettings(thickness_mm=1.0)
