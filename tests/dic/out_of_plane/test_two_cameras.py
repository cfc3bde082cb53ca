"""Tests of shift, slopes and heights from the parallax of two cameras, with exact geometry and noise."""

from dataclasses import replace

import numpy as np
import pytest

from dic.correlation.status import Status
from dic.out_of_plane.reference_surface import reference_surface
from dic.out_of_plane.two_cameras import correct_with_two_cameras
from simulators.scene.optics import PinholeCamera
from simulators.scene.pose import Pose
from tests.dic.out_of_plane.exact_views import State, View, deviations, green_lagrange, strains

ASIDE = View(PinholeCamera(800, 800, tilt_deg=30), seed=4)
STRAIGHT = View(PinholeCamera(800, 800), seed=5)
STRETCH = np.diag([1 - 0.33 * 0.0033, 1.0033])


def corrected(state, views=(ASIDE, STRAIGHT), seen_by=None):
    calibrations = tuple(v.calibration() for v in views)
    seen_by = seen_by or views
    seen = tuple(v.measurements([state], c)[0] for v, c in zip(seen_by, calibrations, strict=True))
    return seen, correct_with_two_cameras(seen, calibrations)


@pytest.mark.parametrize(
    ("slope_deg", "shift_mm", "F"),
    [
        ((0.0, 0.0), 0.02, np.eye(2)),
        ((0.05, -0.15), 0.02, STRETCH),
        ((0.1, 0.1), -0.02, np.diag([0.96, 1.08])),
        ((0.0, 0.0), 0.0, STRETCH),
    ],
)
def test_shift_and_tilt_are_measured_and_their_strain_taken_away(slope_deg, shift_mm, F):
    _, found = corrected(State(Pose.sloped(*slope_deg, shift_mm), F))
    assert found.declined is None
    for correction in (found, *found.corrections):
        error = strains(correction) - green_lagrange(F)
        assert np.abs(error).max() < 20 * (1 + np.abs(F - np.eye(2)).max() * 10)
        assert (np.abs(error) < 3.5 * deviations(correction)).all()
    assert found.plane.shift_mm == pytest.approx(shift_mm, abs=0.0005)
    slopes_deg = np.degrees(np.arctan([found.plane.slope_x, found.plane.slope_y]))
    np.testing.assert_allclose(slopes_deg, slope_deg, atol=0.003)


@pytest.mark.parametrize("mounted", [Pose.sloped(0.0, 0.0, -1.0), Pose.sloped(0.3, -0.5, 0.4)])
def test_the_surface_is_found_wherever_it_is_and_strain_is_right_there(mounted):
    calibrations = tuple(v.calibration() for v in (ASIDE, STRAIGHT))
    surface = reference_surface(ASIDE.seen_by(STRAIGHT, State(mounted)), calibrations)
    away_mm = mounted.apply(np.array([[0.0, 0.0, 0.0]]))[0, 2]
    assert surface.plane.shift_mm == pytest.approx(away_mm, abs=0.003)
    assert f"{abs(away_mm):.1f}" in surface.text
    tilted = Pose.sloped(0.02, 0.12, 0.005)
    state = State(
        Pose(mounted.rotation @ tilted.rotation, mounted.apply(tilted.translation_mm[None])[0]), STRETCH
    )
    seen = tuple(
        v.measurements([state], c, State(mounted))[0]
        for v, c in zip((ASIDE, STRAIGHT), calibrations, strict=True)
    )
    found = correct_with_two_cameras(seen, calibrations, surface)
    assert found.declined is None
    for correction in (found, *found.corrections):
        error = strains(correction) - green_lagrange(STRETCH)
        assert np.abs(error).max() < 12
        assert (np.abs(error) < 3.5 * deviations(correction)).all()
    assert found.plane.shift_mm == pytest.approx(0.005, abs=0.0007)


def test_a_camera_that_was_moved_before_the_reference_is_noticed():
    moved = replace(STRAIGHT, camera=PinholeCamera(800, 800, pan_deg=2.0))
    calibrations = tuple(v.calibration() for v in (ASIDE, STRAIGHT))
    surface = reference_surface(ASIDE.seen_by(moved, State()), calibrations)
    assert surface.plane is None
    assert "moved" in surface.text


def test_references_that_do_not_show_the_same_points_tell_no_surface():
    field = ASIDE.seen_by(STRAIGHT, State())
    lost = replace(field, status=np.full(field.status.shape, Status.NOT_REACHED, np.int8))
    surface = reference_surface(lost, tuple(v.calibration() for v in (ASIDE, STRAIGHT)))
    assert surface.plane is None
    assert "fewer than 30 points" in surface.text


def test_one_camera_takes_the_shift_for_strain():
    seen, found = corrected(State(Pose.sloped(0.0, 0.0, 0.02)))
    straight = seen[1].calibrated_mean
    assert 1e6 * straight.exx == pytest.approx(1e6 * 0.02 / 40, rel=0.05)
    assert np.abs(strains(found)).max() < 20


def test_the_height_map_is_that_of_the_surface():
    _, found = corrected(State(Pose.sloped(0.1, -0.15, 0.02)))
    known = np.isfinite(found.heights_mm)
    position = found.corrections[0].displacement.position[known]
    truth = 0.02 + position @ np.tan(np.radians([0.1, -0.15]))
    z = (found.heights_mm[known] - truth) / found.heights_std_mm[known]
    assert known.sum() > 200
    assert 0.8 < np.sqrt((z**2).mean()) < 1.3


@pytest.mark.parametrize(
    "camera", [PinholeCamera(800, 800, tilt_deg=-3.0), PinholeCamera(800, 800, pan_deg=2.0)]
)
def test_a_camera_that_was_moved_after_calibration_is_noticed(camera):
    moved = (ASIDE, replace(STRAIGHT, camera=camera))
    calibrations = ASIDE.calibration(), STRAIGHT.calibration()
    state = State(Pose.sloped(0.0, 0.1, 0.02), np.diag([0.97, 1.06]))
    seen = tuple(v.measurements([state], c)[0] for v, c in zip(moved, calibrations, strict=True))
    found = correct_with_two_cameras(seen, calibrations)
    assert found.declined is not None
    assert "moved" in found.declined


def test_cameras_that_stand_close_together_tell_no_height():
    views = (STRAIGHT, replace(STRAIGHT, camera=PinholeCamera(800, 800, tilt_deg=3.0), seed=6))
    _, found = corrected(State(), views)
    assert "at least 5°" in found.declined
    assert found.mean is None


def test_cameras_without_common_points_are_refused():
    _, found = corrected(State(), (ASIDE, replace(STRAIGHT, half_mm=0.8)))
    assert found.declined == "a camera has fewer than 30 points"


def test_a_calibration_without_a_camera_is_no_help():
    calibrations = ASIDE.calibration(), replace(STRAIGHT.calibration(), pinhole=None)
    seen = tuple(
        v.measurements([State()], c)[0] for v, c in zip((ASIDE, STRAIGHT), calibrations, strict=True)
    )
    assert "no camera centre" in correct_with_two_cameras(seen, calibrations).declined
