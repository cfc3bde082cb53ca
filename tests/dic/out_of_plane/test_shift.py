"""Tests of the shift that a tilt about the grips' hinge causes, with exact geometry and noise."""

from dataclasses import replace

import numpy as np
import pytest

from dic import CorrectionSettings, Motion
from dic.errors import CorrelationError
from dic.out_of_plane.shift import Shift
from dic.out_of_plane.tension import correct_tilt
from simulators.scene.optics import PinholeCamera
from simulators.scene.pose import Pose
from tests.dic.out_of_plane.exact_views import State, View, deviations, strains

NU = 0.33
F = np.diag([1 - NU * 0.002, 1.002])
HINGE_MM = (0.0, -30.0)
VIEW = View(PinholeCamera(800, 800, tilt_deg=30), noise_px=0.002, seed=5)


def hung(tilt_x_deg, tilt_y_deg, hinge_mm=HINGE_MM):
    """Return a stretched specimen that has tilted about a hinge, with slopes along X and Y."""
    x, y = np.tan(np.radians([tilt_x_deg, tilt_y_deg]))
    axis, angle_deg = np.array([y, -x, 0.0]), np.degrees(np.arctan(np.hypot(x, y)))
    return State(Pose.turned(axis, angle_deg, np.array([*hinge_mm, 0.0])), F)


def corrected(state, shift, view=VIEW):
    calibration = view.calibration()
    (measurement,) = view.measurements([state], calibration)
    found = correct_tilt(measurement, calibration, NU, shift)
    assert found.declined is None
    return found, strains(found) - view.true_strain(measurement, state)


def test_a_hinge_tells_the_shift_that_its_tilt_causes():
    state = hung(0.0, 0.1)
    unknown, off = corrected(state, Shift())
    # 30 mm x 0.1° is a shift of 52 µm, seen from 34.6 mm
    assert off[0] == pytest.approx(1e6 * 30 * np.tan(np.radians(0.1)) / 34.64, rel=0.1)
    known, error = corrected(state, Shift.of(None, HINGE_MM))
    assert np.abs(error).max() < 120
    assert (np.abs(error) < 3 * deviations(known)).all()
    assert deviations(known)[0] < deviations(unknown)[0] / 4
    figures = known.as_dict()
    assert 1e3 * figures["shift_mm"] == pytest.approx(52.4, abs=3.0)
    assert 3.0 < 1e3 * figures["shift_mm_std"] < 8.0


def test_a_tilt_towards_the_side_of_the_hinge_shifts_nothing():
    known, error = corrected(hung(0.1, 0.0), Shift.of(0.0, HINGE_MM))
    assert (np.abs(error) < 3 * deviations(known)).all()
    assert abs(1e3 * known.as_dict()["shift_mm"]) < 4.0


def test_what_the_tilt_does_not_cause_stays_a_part_of_the_uncertainty():
    found, _ = corrected(hung(0.0, 0.1), Shift(20.0, HINGE_MM))
    assert 1e6 * found.as_dict()["exx_std_shift"] == pytest.approx(20 / 34.64 * 1e3, rel=0.03)


def test_strain_that_is_not_corrected_contains_the_shift_of_the_expected_tilt():
    calibration = VIEW.calibration()
    (seen,) = VIEW.measurements([hung(0.0, 0.1)], calibration)
    few = replace(VIEW, half_mm=1.0).measurements([hung(0.0, 0.1)], calibration)[0]
    assert correct_tilt(seen, calibration, NU).declined is None
    found = correct_tilt(few, calibration, NU, Shift.of(0.0, HINGE_MM))
    assert found.declined is not None
    # a slope of 0.1° along Y shifts the specimen by 52 µm; one along X does not
    assert 1e6 * found.as_dict()["exx_std_model"] == pytest.approx(1512, rel=0.03)


@pytest.mark.long
def test_the_interval_contains_the_truth_with_a_hinge():
    inside, total, rms = 0, 0, []
    for seed in range(120):
        rng = np.random.default_rng([7, seed])
        hinge_mm = (float(rng.uniform(-5, 5)), float(rng.choice([-1, 1]) * rng.uniform(15, 60)))
        state = hung(*rng.normal(0.0, 0.1, 2), hinge_mm)
        play = Pose(np.eye(3), np.array([0.0, 0.0, 1e-3 * rng.normal(0.0, 5.0)]))
        state = replace(state, pose=play.after(state.pose))
        found, error = corrected(state, Shift.of(None, hinge_mm), replace(VIEW, seed=seed))
        z = error / deviations(found)
        inside, total = inside + int((np.abs(z) < 1.96).sum()), total + 3
        rms.append(z**2)
    print(f"\n{inside / total:.3f} inside, rms z {np.sqrt(np.mean(rms)):.2f}")
    assert 0.92 <= inside / total <= 0.98


def test_the_default_deviation_is_smaller_with_a_hinge_and_a_declared_one_counts():
    assert Motion("tension").shift == Shift(30.0, grows=True)
    assert Motion("tension", tilt_axis_mm=HINGE_MM).shift == Shift(5.0, HINGE_MM, grows=True)
    assert Motion("tension", shift_std_um=12.0, tilt_axis_mm=HINGE_MM).shift == Shift(12.0, HINGE_MM)


@pytest.mark.parametrize("hinge_mm", [(0.0, np.nan), (0.0, 1e5), (1.0,), [0.0, 1.0, 2.0], "0,1"])
def test_a_hinge_that_is_no_place_is_refused(hinge_mm):
    for settings, given in ((Motion, ("tension",)), (CorrectionSettings, ())):
        with pytest.raises(CorrelationError, match="give --tilt-axis-mm 0,-30"):
            settings(*given, tilt_axis_mm=hinge_mm)


def test_a_rotation_stage_has_no_hinge():
    with pytest.raises(CorrelationError, match="a rotation stage has no grips"):
        Motion("rigid", tilt_axis_mm=HINGE_MM)


def test_settings_in_a_result_file_keep_the_hinge():
    settings = CorrectionSettings(shift_std_um=7.0, tilt_axis_mm=(1.0, -30.0))
    assert CorrectionSettings.from_text(settings.as_text()) == settings
    older = '{"poisson_ratio": 0.3, "alignments": {}, "shift_std_um": 30.0}'
    assert CorrectionSettings.from_text(older) == CorrectionSettings(0.3, {}, 30.0)
