"""Tests of the findings about a test set-up, and of refused requests."""

from dataclasses import replace

import numpy as np
import pytest

from dic.errors import CalibrationError
from dic.out_of_plane.alignment import Alignment, load_alignment, save_alignment
from dic.out_of_plane.correction import Correction
from dic.out_of_plane.diagnosis import Sensitivity, in_grid_axes, tension_findings
from dic.out_of_plane.plane import Plane
from dic.out_of_plane.tension import correct_tilt
from dic.out_of_plane.two_cameras import correct_with_two_cameras
from simulators.scene.optics import PinholeCamera
from simulators.scene.scene import Misalignment
from tests.dic.out_of_plane.exact_views import State, View

ASIDE = View(PinholeCamera(800, 800, pan_deg=30), half_mm=3.4, seed=2)
SOUND = Alignment(np.full(4, 0.003), 1e-10 * np.eye(4), np.zeros(2))


def test_a_rotation_is_not_taken_for_tension():
    stage, calibration = Misalignment(axis_slope_x_deg=0.2), ASIDE.calibration()
    states = [State(stage.mounted().after(stage.turned(a))) for a in (20.0, 180.0)]
    for measurement in ASIDE.measurements(states, calibration, State(stage.mounted())):
        found = correct_tilt(measurement, calibration, 0.33)
        assert found.declined is not None
        assert "the specimen turned by" in found.declined


def test_two_cameras_at_one_place_are_refused_without_a_division_by_zero():
    calibration = ASIDE.calibration()
    measurement = ASIDE.measurements([State()], calibration)[0]
    found = correct_with_two_cameras((measurement, measurement), (calibration, calibration))
    assert "only 0.0° apart" in found.declined


@pytest.mark.parametrize(
    "wrong",
    [
        replace(SOUND, slopes=np.array([0.0, 0.0, 1e9, 0.0])),
        replace(SOUND, covariance=-1e-10 * np.eye(4)),
        replace(SOUND, covariance=np.triu(np.ones((4, 4)))),
    ],
)
def test_an_alignment_that_cannot_be_is_refused(wrong, tmp_path):
    save_alignment(wrong, tmp_path / "a.json")
    with pytest.raises(CalibrationError, match="slopes over 45° or a covariance that is none"):
        load_alignment(tmp_path / "a.json")


def loaded(shift_mm, std_mm):
    stds = np.array([1e-6, 1e-6, std_mm])
    correction = Correction("two cameras", None, None, None, Plane(0.01, 0.0, shift_mm), stds)
    return tension_findings([correction], np.array([1000.0]))[1]


def test_a_shift_within_its_uncertainty_is_no_motion():
    assert loaded(-1e-5, 1e-4) == "it kept its distance from the camera to ± 0.1 µm"
    assert loaded(0.02, 1e-4) == "it moved by +20.0 to +20.0 µm towards the camera"


def test_sensitivity_says_how_little_is_known_of_the_distance():
    calibration = View(PinholeCamera(800, 800), seed=3).calibration()
    sensitivity = Sensitivity.of(calibration)
    z, std = calibration.pinhole.centre_mm[2], calibration.pinhole.centre_std_mm[2]
    assert sensitivity.per_um_std / sensitivity.per_um == pytest.approx(std / z)
    assert sensitivity.per_um_std > 0.3 * sensitivity.per_um
    assert f"± {1e6 * sensitivity.per_um_std:.1f} µε per µm" in sensitivity.text


def test_strain_that_stands_still_is_the_same_at_every_angle_in_the_axes_of_the_grid():
    """ε along X, seen from axes turned by φ: ε cos²φ, ε sin²φ, −ε sin φ cos φ (Mohr)."""
    angles_deg = np.array([0.0, 30.0, 90.0, 200.0])
    c, s = np.cos(np.radians(angles_deg)), np.sin(np.radians(angles_deg))
    turned = 1000.0 * np.column_stack([c * c, s * s, -s * c])
    standing = in_grid_axes(angles_deg, turned)
    np.testing.assert_allclose(standing, np.tile([1000.0, 0.0, 0.0], (4, 1)), atol=1e-9)
    assert standing.shape == (4, 3)
