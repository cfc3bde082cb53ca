"""Tilt told from strain by one camera, in exact geometry with noise."""

from dataclasses import replace

import numpy as np
import pytest

from dic.out_of_plane.tension import correct_tilt
from simulators.scene.optics import PinholeCamera
from simulators.scene.pose import Pose
from tests.dic.out_of_plane.exact_views import State, View, deviations, strains

NU = 0.33
BEND = 300e-6 / 10
"""Curvature, 1/mm: 300 µε over a width of 10 mm."""

VIEW = View(PinholeCamera(800, 800, tilt_deg=30), noise_px=0.004, seed=3)


def bent(p):
    x, y = p.T
    return p + BEND * np.column_stack([-(y * y + NU * x * x) / 2, x * y])


def necking(p):
    y = p[:, 1]
    return np.column_stack([p[:, 0] * (1 - 0.01 / np.cosh(y / 1.2) ** 2), y + 0.024 * np.tanh(y / 1.2)])


def sheared(p):
    slip = 0.01 * np.tanh((p[:, 0] + p[:, 1]) / 0.7)
    return p + np.column_stack([slip, -slip])


def torn(p):
    return p + np.column_stack([np.zeros(len(p)), 0.03 * np.sign(p[:, 1])])


def corrected(state, view=VIEW, calibration=None):
    calibration = calibration or view.calibration()
    (measurement,) = view.measurements([state], calibration)
    return measurement, correct_tilt(measurement, calibration, NU)


@pytest.mark.parametrize("within", [None, bent])
@pytest.mark.parametrize(
    ("slope_deg", "F"),
    [
        ((0.0, 0.15), np.eye(2)),
        ((0.1, -0.1), np.diag([1 - NU * 0.0033, 1.0033])),
        ((-0.15, 0.0), np.diag([0.96, 1.08])),
    ],
)
def test_tilt_is_taken_away_whatever_the_specimen_does_within_its_plane(slope_deg, F, within):
    state = State(Pose.sloped(*slope_deg), F, within)
    measurement, found = corrected(state)
    assert found.declined is None
    error = strains(found) - VIEW.true_strain(measurement, state)
    assert np.abs(error).max() < 50
    assert (np.abs(error) < 3.5 * deviations(found)).all()
    slopes_deg = np.degrees(np.arctan([found.after.slope_x, found.after.slope_y]))
    np.testing.assert_allclose(slopes_deg, slope_deg, atol=0.006)


def test_uncorrected_strain_is_off_by_the_slope_times_the_tangent_of_the_angle():
    measurement, _ = corrected(State(Pose.sloped(0.0, 0.15)))
    false = np.radians(0.15) * np.tan(np.radians(30)) * 1e6
    assert abs(1e6 * measurement.calibrated_mean.eyy) == pytest.approx(false, rel=0.05)


def test_local_displacements_are_corrected_too():
    measurement, found = corrected(State(Pose.sloped(0.0, 0.15)))
    use = found.displacement.valid
    assert np.ptp(measurement.calibrated.vector[use][:, 1]) > 0.008
    # 0.004 px at 70 px/mm, and what is left of the tilt
    assert np.std(found.displacement.vector[use], axis=0).max() < 1.5 * 0.004 / 70


@pytest.mark.parametrize("slope_deg", [0.0, 0.15])
@pytest.mark.parametrize(
    ("within", "reason"), [(necking, "not uniform"), (sheared, "not uniform"), (torn, "uniform|one body")]
)
def test_motion_that_is_not_uniform_is_not_corrected(within, reason, slope_deg):
    measurement, found = corrected(State(Pose.sloped(0.0, slope_deg), np.eye(2), within))
    assert found.declined is not None
    assert any(words in found.declined for words in reason.split("|"))
    assert found.mean is measurement.calibrated_mean
    assert found.as_dict()["applied"] is False


def test_a_calibration_without_a_camera_is_no_help():
    calibration = replace(VIEW.calibration(), pinhole=None)
    _, found = corrected(State(), calibration=calibration)
    assert found.declined == "the calibration knows no camera centre"


def test_too_few_points_are_not_corrected():
    _, found = corrected(State(), replace(VIEW, half_mm=1.0))
    assert found.declined is not None
    assert "too few" in found.declined


def test_a_camera_straight_on_sees_next_to_no_false_strain_of_a_tilt():
    view = replace(VIEW, camera=PinholeCamera(800, 800))
    state = State(Pose.sloped(0.0, 0.15), np.diag([1 - NU * 0.0022, 1.0022]))
    measurement, found = corrected(state, view)
    error = strains(found) - view.true_strain(measurement, state)
    assert (np.abs(error) < np.maximum(3.5 * deviations(found), 20)).all()


def test_noise_too_large_to_tell_a_tilt_is_named():
    _, found = corrected(State(), replace(VIEW, noise_px=0.1))
    assert found.declined is not None
    assert "too uncertain" in found.declined


def test_one_camera_claims_nothing_of_the_shift():
    _, found = corrected(State(Pose.sloped(0.0, 0.1, 0.01)))
    figures = found.as_dict()
    assert figures["shift_mm"] is None
    assert figures["shift_mm_std"] is None
