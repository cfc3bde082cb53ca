"""Tests of the report's section on the set-up: geometry, findings, motion of the plane, harmonics."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from dic.calibration.pinhole.camera import Pinhole
from dic.runfile.reader import RunStep
from tests.dic.report.page import Page, written
from tests.dic.report.runs import camera, corrected_tension_run, given, rotation_run, turn


def test_set_up_is_what_geometry_says_of_the_camera(tmp_path: Path) -> None:
    """C = 40 mm at 30°: Cy = 20, Cz = 34.64 mm; tan 30° · 1 m° = 10.1 µε, 1 µm / Cz = 28.9 µε.

    Errors of 0.02 mm in Cy and 0.1 mm in Cz turn the line of sight by
    hypot(0.02 · cos 30°, 0.1 · sin 30°) / 40 = 0.00132 = 0.076°.
    """
    run = corrected_tension_run()
    covariance = np.zeros((13, 13))
    covariance[10:, 10:] = np.diag([0.01, 0.02, 0.1]) ** 2
    pinhole = replace(Pinhole.swung(tilt_deg=30.0), covariance=covariance)
    known = [replace(c, calibration=replace(c.calibration, pinhole=pinhole)) for c in run.cameras]
    run = given(
        replace(run, cameras=known), "tension", dict(run.corrections.cameras),
        joint=run.corrections.joint, findings=run.corrections.findings,
    )  # fmt: skip
    page = Page(written(tmp_path, run, fields=False, drawn=False))
    row = page.table("setup")[3]
    assert row[:2] == ["off_axis 30.0°", "30.000 ± 0.076"]
    assert [cell.lstrip("−") for cell in row[2:5]] == ["0.000 ± 0.010", "20.000 ± 0.020", "34.64 ± 0.10"]
    assert row[5:] == ["10.1", "28.9", "± 2.0", "± 6"]
    text = " ".join(page.text.split())
    assert (
        "off_axis 30.0°: a shift by w towards the camera strains all directions by w/Cz, 28.9 µε per µm"
        in text
    )
    assert (
        "The standard deviations assume this shift: ± 30 µm and more with the travel of the grips, "
        "for one camera." in text
    )
    # The largest measured shift is that of the last step that has a joint solution: 3 · 0.5 µm.
    assert "at most 1.50 ± 0.25 µm, which makes 43 ± 7 µε" in text


def test_findings_are_said_under_the_camera_they_belong_to(corrected_html: str) -> None:
    text = " ".join(Page(corrected_html).text.split())
    assert "off_axis 30.0° The specimen tilted by −0.08°." in text
    assert "off_axis 30.0° and on_axis together It moved." in text


def test_tension_shows_the_motion_of_the_plane_and_heights_at_the_largest_load(corrected_html: str) -> None:
    page = Page(corrected_html)
    shown = page.values("alt")
    for figure in ("Corrected differences", "Motion of the specimen's plane", "Heights of the specimen"):
        assert sum(alt.startswith(figure) for alt in shown) == 1
    captions = [" ".join(caption.split()) for caption in page.captions]
    # At step 7 the load is larger, but the cameras disagreed.
    assert any("at the step of the largest load, step 4;" in caption for caption in captions)


def test_harmonics_are_shown_where_the_angles_tell_them(tmp_path: Path, rotation_html: str) -> None:
    angles = np.arange(30.0, 361.0, 30.0)
    steps = [RunStep(2 + k, "rotation", a, np.nan, np.nan, a, k) for k, a in enumerate(angles)]
    run = rotation_run(30.0, 0.001)
    full = replace(run, cameras=[camera("on_axis", steps, [turn(a, 0.001) for a in angles])])
    alt = "Strain in the grid's axes with its harmonics"
    assert (
        Page(written(tmp_path, given(full, "free", {}), fields=False, drawn=False)).values("alt").count(alt)
        == 1
    )
    # Three angles do not tell five coefficients.
    assert alt not in Page(rotation_html).values("alt")
