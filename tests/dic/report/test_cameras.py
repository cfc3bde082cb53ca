"""The report takes the position of a camera from the calibration alone, and never from the rig file."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dic.calibration.pinhole.camera import Pinhole
from dic.pipeline.result import RunResult
from dic.report.paper import compare
from dic.report.series import number_runs
from dic.report.setup import camera_rows
from tests.dic.report.page import written
from tests.dic.report.runs import INFO, tension_run

OTHER_ANGLES = "pan_deg = 50.0\ntilt_deg = 0.0\n"
"""Lines that are added to the off-axis camera's table in the rig file."""


def seen_by(pinhole: Pinhole | None) -> RunResult:
    """Return a tension run whose off-axis camera has the position of `pinhole`."""
    run = tension_run()
    off_axis, on_axis = run.cameras
    off_axis = replace(off_axis, calibration=replace(off_axis.calibration, pinhole=pinhole))
    return replace(run, cameras=[off_axis, on_axis])


def uncertain(pinhole: Pinhole, std_mm: float) -> Pinhole:
    """Return the camera with the standard deviation `std_mm` of its centre along each axis."""
    covariance = np.zeros((13, 13))
    covariance[10:, 10:] = std_mm**2 * np.eye(3)
    return replace(pinhole, covariance=covariance)


def bias(run: RunResult) -> tuple[str, str]:
    """Return the camera whose bias the report states, and the text of the bias."""
    row = next(row for row in compare(number_runs([run])) if "calibrated off-axis camera" in row.quantity)
    (entry,) = row.entries
    return entry.where, entry.ours


def test_angle_is_that_of_the_fitted_camera_on_a_rig_whose_file_tells_none() -> None:
    """40 mm away, 0.1 mm uncertain in all directions: the line of sight is known to 0.1/40 rad = 0.14°."""
    assert "_deg" not in INFO.configuration
    run = seen_by(uncertain(Pinhole.swung(tilt_deg=30.0), 0.1))
    (numbered,) = number_runs([run])
    assert [camera.label for camera in numbered.cameras] == ["on_axis", "off_axis 30.0°"]
    assert camera_rows(numbered)[1][:2] == ["off_axis 30.0°", "30.00 ± 0.14"]
    assert bias(run) == ("run 1, off_axis 30.0°", "εyy −1000 µε")


@pytest.mark.extended
def test_rig_file_that_contradicts_the_fitted_camera_changes_nothing_but_its_own_text(
    tmp_path: Path, tension_html: str
) -> None:
    """Nor does anything else differ between two reports of the same run."""
    contradicted = tension_run(configuration=INFO.configuration + OTHER_ANGLES)
    html = written(tmp_path, contradicted, fields=False, drawn=False)
    assert OTHER_ANGLES in html
    assert html.replace(OTHER_ANGLES, "") == tension_html
    assert "off_axis 30.0°" in html


@pytest.mark.extended
def test_rig_file_changes_no_drawn_picture_and_no_field(tmp_path: Path) -> None:
    html = written(tmp_path, tension_run(configuration=INFO.configuration + OTHER_ANGLES))
    assert html.replace(OTHER_ANGLES, "") == written(tmp_path, tension_run())


@pytest.mark.parametrize(
    ("angles", "words"),
    [
        ({"pan_deg": 30.0}, "εxx 0 µε"),
        ({"tilt_deg": 30.0}, "εyy −1000 µε"),
        ({"pan_deg": 5.0, "tilt_deg": 30.0}, "εyy −1000 µε"),
        ({"pan_deg": 20.0, "tilt_deg": 20.0}, "εxx 0 µε, εyy −1000 µε"),
    ],
)
def test_bias_is_given_in_the_direction_in_which_the_camera_leans(
    angles: dict[str, float], words: str
) -> None:
    assert bias(seen_by(Pinhole.swung(**angles)))[1] == words


@pytest.mark.parametrize(
    "pinhole",
    [
        pytest.param(None, id="no pinhole"),
        pytest.param(Pinhole.swung(tilt_deg=0.5), id="half a degree"),
        # 10 mm at 40 mm is 14°.
        pytest.param(uncertain(Pinhole.swung(tilt_deg=30.0), 10.0), id="30° ± 14°"),
    ],
)
def test_camera_that_is_not_clearly_aside_goes_by_its_name_alone(pinhole: Pinhole | None) -> None:
    assert bias(seen_by(pinhole)) == ("run 1, off_axis", "εxx 0 µε, εyy −1000 µε")
