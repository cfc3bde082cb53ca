"""One camera distinguishes a tilt of the specimen from strain, with exact geometry and noise."""

from dataclasses import replace

import numpy as np
import pytest

from dic.out_of_plane.correction import stated
from dic.out_of_plane.shift import Shift
from dic.out_of_plane.strain_parts import PART_NAMES
from dic.out_of_plane.tension import correct_tilt
from simulators.scene.optics import PinholeCamera
from simulators.scene.pose import Pose
from tests.dic.out_of_plane.exact_views import State, View, deviations, strains

NU = 0.33
NAMES = ("exx", "eyy", "exy")
BEND = 300e-6 / 10
"""Curvature by in-plane bending, 1/mm, which causes 300 µε over a width of 10 mm."""

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
    """Return the correction of one camera's image of a specimen whose shift is known to 1 µm."""
    calibration = calibration or view.calibration()
    (measurement,) = view.measurements([state], calibration)
    return measurement, correct_tilt(measurement, calibration, NU, Shift(1.0))


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


@pytest.mark.parametrize(
    ("mounted", "cause"), [((0.1, 0.0, 0.0), 0), ((0.0, 0.1, 0.0), 1), ((0.0, 0.0, 0.3), 2)]
)
@pytest.mark.parametrize("motion_deg", [(0.05, 0.2), pytest.param((0.2, -0.1), marks=pytest.mark.extended)])
def test_stated_error_of_the_mounting_is_the_error_that_a_mounted_specimen_has(mounted, cause, motion_deg):
    view = replace(VIEW, noise_px=1e-4, grid_noise_px=1e-4)
    calibration, F = view.calibration(), np.diag([1 - NU * 0.002, 1.002])
    found = []
    for slope_x, slope_y, gap_mm in ((0.0, 0.0, 0.0), mounted):
        reference = State(Pose.sloped(slope_x, slope_y, gap_mm))
        moved = State(Pose.sloped(slope_x + motion_deg[0], slope_y + motion_deg[1], gap_mm), F)
        (measurement,) = view.measurements([moved], calibration, reference)
        found.append(correct_tilt(measurement, calibration, NU, Shift(1.0)))
    stated_mounting = 1e6 * found[0].mounting[:, cause]
    assert np.abs(stated_mounting).max() > 1.5
    np.testing.assert_allclose(strains(found[1]) - strains(found[0]), stated_mounting, rtol=0.05, atol=0.1)
    parts = np.array([found[0].uncertainty[f"{name}_std_mounting"] for name in NAMES])
    np.testing.assert_allclose(np.linalg.norm(found[0].mounting, axis=1), parts, rtol=0.02)


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


@pytest.mark.parametrize("slope_deg", [pytest.param(0.0, marks=pytest.mark.extended), 0.15])
@pytest.mark.parametrize(
    ("within", "reason"),
    [(necking, "necks"), pytest.param(sheared, "shears", marks=pytest.mark.extended), (torn, "tears")],
)
def test_motion_that_is_not_uniform_is_not_corrected(within, reason, slope_deg):
    measurement, found = corrected(State(Pose.sloped(0.0, slope_deg), np.eye(2), within))
    assert found.declined is not None
    assert reason in found.declined
    np.testing.assert_allclose(
        strains(found), 1e6 * np.array([getattr(measurement.calibrated_mean, n) for n in NAMES]), atol=1e-6
    )
    assert found.as_dict()["applied"] is False


def test_strain_that_is_not_corrected_states_the_tilt_and_the_shift_to_be_expected():
    state = State(Pose.sloped(0.0, 0.15), np.eye(2), torn)
    view, calibration = VIEW, VIEW.calibration()
    (measurement,) = view.measurements([state], calibration)
    found = correct_tilt(measurement, calibration, NU, Shift(20.0))
    figures = found.as_dict()
    # 0.1° seen at 30°, and 20 µm seen from the height of 34.64 mm.
    assert 1e6 * figures["eyy_std_model"] == pytest.approx(
        np.radians(0.1) * np.tan(np.radians(30)) * 1e6, rel=0.05
    )
    height_mm = 40 * np.cos(np.radians(30))
    assert 1e6 * figures["exx_std_shift"] == pytest.approx(0.02 / height_mm * 1e6, rel=0.02)
    parts = [figures[f"eyy_std_{part}"] for part in PART_NAMES]
    assert figures["eyy_std"] == pytest.approx(np.linalg.norm(parts), rel=1e-6)
    assert stated(measurement, found).calibrated_mean.eyy_std == pytest.approx(found.mean.eyy_std, rel=1e-3)


def test_calibrated_strain_is_as_uncertain_as_its_correction_shows():
    measurement, found = corrected(State(Pose.sloped(0.0, 0.15)))
    off = abs(measurement.calibrated_mean.eyy)
    known = stated(measurement, found)
    assert known.calibrated_mean.eyy_std == pytest.approx(off, rel=0.1)
    # The same error is at every point, and the noise of the images beside it keeps its own name.
    use = np.isfinite(known.strain.eyy)
    assert known.strain.eyy_std[use].min() > 0.9 * off
    np.testing.assert_array_equal(known.strain.eyy_std_images[use], measurement.strain.eyy_std[use])
    assert known.summary()["calibrated"]["eyy_std_images"] == measurement.calibrated_mean.eyy_std
    assert known.strain.eyy_std_images[use].max() < 0.2 * off


def test_the_shift_is_a_stated_part_of_the_uncertainty():
    state, calibration = State(Pose.sloped(0.0, 0.05, 0.05)), VIEW.calibration()
    (measurement,) = VIEW.measurements([state], calibration)
    found = correct_tilt(measurement, calibration, NU)
    assert found.declined is None
    error = strains(found) - VIEW.true_strain(measurement, state)
    assert error[:2].min() > 1400
    assert (np.abs(error) < 2 * deviations(found)).all()
    parts = found.as_dict()
    assert parts["exx_std_shift"] > 20 * parts["exx_std_images"]


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
    _, found = corrected(State(Pose.sloped(0.0, 0.03)), replace(VIEW, noise_px=0.1))
    assert found.declined is not None
    assert "too uncertain" in found.declined


def test_one_camera_claims_nothing_of_the_shift():
    _, found = corrected(State(Pose.sloped(0.0, 0.1, 0.01)))
    figures = found.as_dict()
    assert figures["shift_mm"] is None
    assert figures["shift_mm_std"] is None
