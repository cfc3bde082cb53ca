"""Tests of calibrations of a surface behind the grid's lines, with points from exact geometry."""

from dataclasses import replace

import numpy as np
import pytest

from dic.calibration.calibration import Calibration
from dic.calibration.file import load_calibration, save_calibration
from dic.calibration.plate import behind
from dic.errors import CalibrationError
from dic.targets.points import GridPoints
from simulators.scene.optics import PinholeCamera

CAMERA = PinholeCamera(800, 800, pan_deg=10.0, tilt_deg=28.0)


def calibrated():
    index = np.stack(np.meshgrid(np.arange(21), np.arange(21)), axis=-1).reshape(-1, 2)
    xyz = np.column_stack([(index - 10) * 0.5, np.zeros(len(index))])
    grid = GridPoints.on_lattice(index.astype(np.int64), CAMERA.project(xyz), (21, 21), 0.5)
    return Calibration.fit(grid, (800, 800))


@pytest.mark.parametrize("model", ["bicubic", "pinhole"])
@pytest.mark.parametrize("plate_mm", [1.0, -0.3])
def test_points_of_the_surface_are_met_where_they_are(model, plate_mm):
    found = behind(calibrated().using(model), plate_mm)
    x, y = (axis.ravel() for axis in np.meshgrid(*[np.linspace(-3, 3, 9)] * 2))
    seen = CAMERA.project(np.column_stack([x, y, np.full(81, -plate_mm)]))
    # The bicubic map fits perspective to a few tenths of a micrometre only, also on the grid itself.
    atol = 1e-5 if model == "pinhole" else 1e-3
    np.testing.assert_allclose(found.map(seen), np.column_stack([x, y]), atol=atol)
    away_mm = CAMERA.centre_mm + np.array([0.0, 0.0, plate_mm])
    np.testing.assert_allclose(found.pinhole.centre_mm, away_mm, atol=1e-3)


def test_residuals_grow_with_the_scale_and_not_otherwise():
    plain = calibrated()
    moved = behind(plain, 1.0)
    scale = 1 + 1.0 / CAMERA.centre_mm[2]
    assert moved.rms_mm == pytest.approx(scale * plain.rms_mm, rel=1e-3)
    assert moved.rms_px == pytest.approx(plain.rms_px, rel=1e-3)
    assert moved.mm_per_px == pytest.approx(scale * plain.mm_per_px, rel=1e-3)


def test_a_calibration_file_keeps_the_plate(tmp_path):
    moved = behind(calibrated(), 1.0)
    save_calibration(moved, tmp_path / "cal.h5")
    read = load_calibration(tmp_path / "cal.h5")
    assert read.plate_mm == 1.0
    px = np.array([[300.0, 500.0]])
    np.testing.assert_allclose(read.map(px), moved.map(px), rtol=1e-12)


def test_a_plate_needs_the_cameras_centre_and_a_sensible_thickness():
    with pytest.raises(CalibrationError, match="pinhole model"):
        behind(replace(calibrated(), pinhole=None), 1.0)
    for plate_mm in (30.0, float("nan")):
        with pytest.raises(CalibrationError, match="give --plate-mm 1"):
            behind(calibrated(), plate_mm)
