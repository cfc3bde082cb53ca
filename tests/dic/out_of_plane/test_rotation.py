"""Tests of the alignment that is solved from a rigid rotation, with exact geometry and noise."""

from dataclasses import replace

import numpy as np
import pytest

from dic.errors import CalibrationError
from dic.out_of_plane.alignment import Alignment, load_alignment, save_alignment
from dic.out_of_plane.correct import correct
from dic.out_of_plane.motion import Motion
from dic.out_of_plane.rigidity import correct_rotation
from dic.out_of_plane.rotation import StepErrors
from simulators.scene.optics import PinholeCamera
from simulators.scene.pose import Pose
from simulators.scene.scene import Misalignment
from tests.dic.out_of_plane.exact_views import State, View, deviations, green_lagrange, strains

TURNS_DEG = np.arange(1, 9) * 45.0
VIEW = View(PinholeCamera(800, 800, pan_deg=30), half_mm=3.4, seed=1)


def turned(misalignment, turns_deg=TURNS_DEG, F=None):
    mounted = misalignment.mounted()
    F = np.eye(2) if F is None else F
    return [State(mounted.after(misalignment.turned(a)), F) for a in turns_deg], State(mounted)


def corrected(misalignment, view=VIEW, turns_deg=TURNS_DEG, alignment=None, F=None):
    calibration = view.calibration()
    states, reference = turned(misalignment, turns_deg, F)
    measurements = view.measurements(states, calibration, reference)
    return measurements, correct_rotation(measurements, calibration, alignment)


@pytest.mark.parametrize(
    "misaligned",
    [
        pytest.param({}, marks=pytest.mark.extended),
        pytest.param({"axis_slope_x_deg": 0.2}, marks=pytest.mark.extended),
        {"axis_slope_y_deg": -0.2, "axis_x_mm": 0.5},
        {"axis_slope_x_deg": -0.14, "axis_slope_y_deg": 0.14, "grid_slope_y_deg": 0.1},
        {"grid_slope_x_deg": 0.1, "grid_gap_mm": 0.05},
    ],
)
def test_wobble_and_grid_tilt_are_found_and_leave_no_strain(misaligned):
    misalignment = Misalignment(**misaligned)
    _, found = corrected(misalignment)
    for correction in found.corrections:
        assert correction.declined is None
        assert np.abs(strains(correction)).max() < 20
    wobble = [misalignment.axis_slope_x_deg, misalignment.axis_slope_y_deg]
    grid = [misalignment.grid_slope_x_deg, misalignment.grid_slope_y_deg]
    np.testing.assert_allclose(found.alignment.wobble_deg, wobble, atol=0.002)
    np.testing.assert_allclose(np.degrees(np.arctan(found.alignment.slopes[:2])), grid, atol=0.002)


def test_without_noise_the_alignment_is_exact_although_false_strain_falsifies_the_angles():
    view = replace(VIEW, noise_px=1e-6, grid_noise_px=1e-6)
    _, found = corrected(Misalignment(axis_slope_x_deg=0.2, axis_x_mm=0.3), view)
    np.testing.assert_allclose(found.alignment.wobble_deg, [0.2, 0.0], atol=2e-5)
    assert max(np.abs(strains(c)).max() for c in found.corrections) < 0.1


def test_the_false_strain_of_half_a_turn_is_twice_the_wobble_times_the_tangent():
    measurements, _ = corrected(Misalignment(axis_slope_x_deg=0.2), turns_deg=[180.0])
    false = 2 * np.radians(0.2) * np.tan(np.radians(30)) * 1e6
    assert abs(1e6 * measurements[0].calibrated_mean.exx) == pytest.approx(false, rel=0.03)


def test_a_stretch_that_grows_with_the_turn_is_not_rigid():
    calibration = VIEW.calibration()
    states = [
        State(Pose.turned(np.array([0.0, 0.0, 1.0]), a, np.zeros(3)), np.diag([1.0, 1 + 2e-4 * k]))
        for k, a in enumerate(TURNS_DEG)
    ]
    found = correct_rotation(VIEW.measurements(states, calibration), calibration)
    assert found.alignment is None
    assert all("not rigid" in c.declined for c in found.corrections)


@pytest.mark.parametrize(
    ("turns_deg", "reason"), [([1.0, 2.0], "less than 5°"), ([90.0], "at least 2 images")]
)
def test_too_little_of_a_rotation_is_refused(turns_deg, reason):
    _, found = corrected(Misalignment(axis_slope_x_deg=0.2), turns_deg=turns_deg)
    assert found.alignment is None
    assert reason in found.corrections[0].declined


def test_a_calibration_without_a_camera_is_no_help():
    calibration = replace(VIEW.calibration(), pinhole=None)
    states, reference = turned(Misalignment())
    found = correct_rotation(VIEW.measurements(states, calibration, reference), calibration)
    assert "no camera centre" in found.corrections[0].declined


def test_a_camera_straight_on_keeps_its_strain_and_tells_no_wobble():
    view = replace(VIEW, camera=PinholeCamera(800, 800))
    _, found = corrected(Misalignment(axis_slope_x_deg=0.2), view)
    assert found.alignment is None
    assert len(found.corrections) == len(TURNS_DEG)
    for correction in found.corrections:
        assert "too straight on to measure tilts" in correction.declined
        assert np.abs(strains(correction)).max() < 20


def test_an_alignment_serves_another_run_on_the_same_fixture_even_if_that_is_strained(tmp_path):
    misalignment = Misalignment(axis_slope_x_deg=0.15, axis_slope_y_deg=0.1, grid_slope_x_deg=0.05)
    _, solved = corrected(misalignment)
    save_alignment(solved.alignment, tmp_path / "fixture.json")
    kept = load_alignment(tmp_path / "fixture.json")
    F = np.diag([0.999, 1.003])
    _, found = corrected(misalignment, replace(VIEW, seed=9), [60.0, 200.0], kept, F)
    for correction in found.corrections:
        assert correction.method == "alignment"
        error = strains(correction) - green_lagrange(F)
        assert np.abs(error).max() < 20
        assert (np.abs(error) < 3.5 * deviations(correction)).all()


def test_a_saved_alignment_is_read_back_whole(tmp_path):
    _, solved = corrected(Misalignment(axis_slope_x_deg=0.2), turns_deg=[90.0, 180.0])
    save_alignment(solved.alignment, tmp_path / "a.json")
    kept = load_alignment(tmp_path / "a.json")
    for name in ("slopes", "covariance", "pivot_mm"):
        np.testing.assert_array_equal(getattr(kept, name), getattr(solved.alignment, name))


@pytest.mark.parametrize("content", [None, "", "{}", "[1]", '{"file_format": "offaxis-alignment"}', "\x00"])
def test_a_file_that_is_no_alignment_is_refused(tmp_path, content):
    path = tmp_path / "a.json"
    if content is not None:
        path.write_text(content)
    with pytest.raises(CalibrationError, match="expected an alignment"):
        load_alignment(path)


def test_the_plane_after_a_turn_is_that_of_the_simulated_stage():
    misalignment = Misalignment(
        axis_slope_x_deg=0.3, axis_slope_y_deg=-0.2, axis_x_mm=1.0, grid_slope_y_deg=0.4
    )
    mounted = misalignment.mounted()
    axis = mounted.rotation @ np.array([*np.tan(np.radians([0.3, -0.2])), 1.0])
    pivot = mounted.apply(np.array([[1.0, 0.0, 0.0]]))[0]
    slopes = np.array([0.0, np.tan(np.radians(0.4)), *(axis[:2] / axis[2])])
    alignment = Alignment(slopes, np.zeros((4, 4)), pivot[:2])
    for angle in (30.0, 180.0, 305.0):
        pose = mounted.after(misalignment.turned(angle))
        corners = pose.apply(np.array([[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0]]))
        plane = alignment.after(angle)
        heights = plane.shift_mm + corners[:, :2] @ [plane.slope_x, plane.slope_y]
        np.testing.assert_allclose(heights, corners[:, 2], atol=1e-12)


def test_motion_names_the_correction():
    calibration = VIEW.calibration()
    states, reference = turned(Misalignment(axis_slope_x_deg=0.2), [90.0, 180.0])
    measurements = VIEW.measurements(states, calibration, reference)
    assert [c.method for c in correct(measurements, calibration, Motion("rigid")).images] == ["rigidity"] * 2
    free = correct(measurements, calibration, Motion())
    assert all(c.declined is not None and c.method == "none" for c in free.images)


def test_errors_in_two_parts_are_those_of_the_whole_covariance():
    rng = np.random.default_rng(8)
    steps, values, shared = 7, 3, 5
    root = rng.normal(size=(steps, values, values))
    errors = StepErrors(root @ np.swapaxes(root, 1, 2), 3.0 * rng.normal(size=(steps, values, shared)))
    whole = np.zeros((steps * values, steps * values))
    for k in range(steps):
        whole[values * k : values * (k + 1), values * k : values * (k + 1)] = errors.own[k]
    effect = errors.shared.reshape(steps * values, shared)
    whole += effect @ effect.T
    right = rng.normal(size=(steps * values, 4))
    np.testing.assert_allclose(errors.solve(right), np.linalg.solve(whole, right), rtol=1e-9, atol=1e-11)
    by = rng.normal(size=(steps, 2, values))
    mapped = errors.mapped(by)
    for k in range(steps):
        block = whole[values * k : values * (k + 1), values * k : values * (k + 1)]
        found = mapped.own[k] + mapped.shared[k] @ mapped.shared[k].T
        np.testing.assert_allclose(found, by[k] @ block @ by[k].T, rtol=1e-10)
