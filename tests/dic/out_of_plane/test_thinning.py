"""Tests of the shift towards the camera that a specimen's thinning causes, with exact geometry and noise.

The true strain of the thickness is that of an elastic and plastic material with a known yield strain.
"""

import numpy as np
import pytest

from dic import CorrectionSettings, Motion
from dic.errors import CorrelationError
from dic.out_of_plane.diagnosis import contraction_findings
from dic.out_of_plane.shift import Shift
from dic.out_of_plane.tension import correct_tilt
from dic.out_of_plane.thinning import receded, thickness_strain
from simulators.scene.optics import PinholeCamera
from simulators.scene.pose import Pose
from tests.dic.out_of_plane.exact_views import State, View, deviations, strains

NU = 0.33
VIEW = View(PinholeCamera(800, 800, tilt_deg=30), noise_px=0.002, seed=5)
SHARE = {"middle": 0.5, "back": 1.0, "front": 0.0}


def stretches(strain, *, yield_strain=0.004, nu=NU, r=1.0):
    """Return the stretches along, across and through a sheet with the strain ratio r."""
    elastic = min(strain, yield_strain)
    plastic = np.log1p(strain) - np.log1p(elastic)
    narrowed = np.log1p(-nu * elastic)
    return 1 + strain, np.exp(narrowed - plastic * r / (1 + r)), np.exp(narrowed - plastic / (1 + r))


def stretched(strain, thickness_mm, face, *, pose=None, shift_um=0.0, **material):
    along, across, through = stretches(strain, **material)
    height_mm = SHARE[face] * thickness_mm * (through - 1) + 1e-3 * shift_um
    own = Pose(translation_mm=np.array([0.0, 0.0, height_mm]))
    return State(own if pose is None else own.after(pose), np.diag([across, along]))


def corrected(state, shift, view=VIEW, nu=NU, reference=None):
    calibration = view.calibration()
    (measurement,) = view.measurements([state], calibration, reference)
    found = correct_tilt(measurement, calibration, nu, shift)
    error = strains(found) - view.true_strain(measurement, state, reference=reference)
    return found, error


def test_the_thickness_follows_from_poissons_ratio_and_from_constant_volume():
    elastic, _ = thickness_strain(np.diag([-NU * 5e-4, 5e-4]), NU)
    assert elastic == pytest.approx(-NU * 5e-4, rel=2e-3)
    for r in (0.6, 1.0, 2.0):
        along, across, through = stretches(0.2, r=r)
        mean, std = thickness_strain(np.diag([across - 1, along - 1]), NU)
        assert mean == pytest.approx(through - 1, abs=2 * std)
        assert mean == pytest.approx(through - 1, rel=0.02)


def test_shift_and_strain_are_found_together():
    along, across, through = stretches(0.2)
    shift_mm = 3.0 * (through - 1)
    seen = np.diag([across, along]) * 35.0 / (35.0 - shift_mm) - np.eye(2)
    gradient, found_mm, gain, _ = receded(seen, NU, 6.0, "middle", 35.0)
    assert found_mm == pytest.approx(shift_mm, rel=0.02)
    np.testing.assert_allclose(gradient, np.diag([across - 1, along - 1]), atol=2e-4)
    step = 1e-5 * np.array([[0.0, 0.0], [0.0, 1.0]])
    ahead = receded(seen + step, NU, 6.0, "middle", 35.0)[0]
    np.testing.assert_allclose((ahead - gradient).ravel() / 1e-5, gain[:, 3], rtol=1e-3, atol=1e-5)


@pytest.mark.parametrize(("thickness_mm", "face"), [(2.0, "middle"), (6.0, "back")])
def test_the_false_strain_of_thinning_is_corrected(thickness_mm, face):
    state = stretched(0.2, thickness_mm, face)
    _, before = corrected(state, Shift(0.0))
    found, error = corrected(state, Shift(0.0, None, thickness_mm, face))
    assert found.declined is None
    assert np.abs(before).max() > 3500
    assert np.abs(error).max() < 300
    assert (np.abs(error) < 2 * deviations(found)).all()


def test_elastic_strain_of_a_thick_specimen_is_corrected():
    found, error = corrected(stretched(0.002, 6.0, "back"), Shift(0.0, None, 6.0, "back"))
    # 1 % of the strain along the load, 4 % of that across it
    assert abs(error[1]) < 20
    assert abs(error[0]) < 26
    assert found.as_dict()["thinning_um"] == pytest.approx(-6e3 * NU * 0.002, rel=0.02)


def test_modulus_and_poissons_ratio_of_a_thick_specimen_are_those_of_the_material():
    # The ratio of the material is not the expected one, and its strains tell so.
    nu, loads = 0.29, np.array([0.0005, 0.0012, 0.002])
    means = [
        corrected(stretched(e, 6.0, "back", nu=nu), Shift(0.0, None, 6.0, "back"))[0].mean for e in loads
    ]
    along, across = (np.polyfit(loads, [getattr(m, name) for m in means], 1)[0] for name in ("eyy", "exx"))
    assert along == pytest.approx(np.polyfit(loads, loads + loads**2 / 2, 1)[0], rel=0.01)
    assert -across / along == pytest.approx(nu, rel=0.04)


def test_a_face_that_is_not_known_enters_the_standard_deviation():
    for face in SHARE:
        found, error = corrected(stretched(0.1, 4.0, face), Shift(0.0, None, 4.0, None))
        assert (np.abs(error) < 2 * deviations(found)).all()


def test_a_thickness_that_is_not_known_enters_the_default_shift():
    small, large = (corrected(stretched(e, 2.0, "middle"), Shift.of(None, None)) for e in (0.002, 0.2))
    assert deviations(small[0])[0] == pytest.approx(30 / 34.64 * 1e3, rel=0.01)
    assert (np.abs(large[1]) < 2 * deviations(large[0])).all()
    declared, _ = corrected(stretched(0.2, 2.0, "middle"), Shift.of(1.0, None))
    # the last factor is the scale that a shift acts on
    assert 1e6 * declared.as_dict()["exx_std_shift"] == pytest.approx(1 / 34.64 * 1e3 * 0.833, rel=0.02)


def test_a_contraction_that_contradicts_the_shift_is_told_and_covered():
    state = stretched(0.002, 1.0, "front", shift_um=-117.0)
    found, error = corrected(state, Shift.of(5.0, None))
    assert found.as_dict()["contraction_um"] == pytest.approx(-117, abs=6)
    assert (np.abs(error) < 2 * deviations(found)).all()
    (sentence,) = contraction_findings([found])
    assert "in 1 of 1 images" in sentence
    agreeing, _ = corrected(stretched(0.002, 1.0, "front"), Shift.of(5.0, None))
    assert contraction_findings([agreeing]) == []
    turn, (along, across, _) = np.radians(1.5), stretches(0.002)
    c, s = np.cos(turn), np.sin(turn)
    turned = State(F=np.array([[c, -s], [s, c]]) @ np.diag([across, along]))
    assert contraction_findings([corrected(turned, Shift.of(1.0, None))[0]]) == []
    yielded, _ = corrected(stretched(0.02, 1.0, "front"), Shift.of(5.0, None))
    assert contraction_findings([yielded]) == []


def test_strain_that_is_not_corrected_contains_the_thinning():
    view = View(PinholeCamera(800, 800, tilt_deg=30), noise_px=0.002, half_mm=1.0, seed=5)
    found, error = corrected(stretched(0.1, 4.0, "middle"), Shift(0.0, None, 4.0, "middle"), view)
    assert found.declined is not None
    assert 1e6 * found.as_dict()["eyy_std_shift"] == pytest.approx(abs(error[1]), rel=0.3)


def test_settings_keep_the_thickness_and_refuse_what_cannot_be():
    settings = CorrectionSettings(thickness_mm=2.0, fixed_face="back")
    assert CorrectionSettings.from_text(settings.as_text()) == settings
    motion = Motion("tension", thickness_mm=2.0, fixed_face="back")
    assert Motion.from_dict(motion.as_dict()) == motion
    assert motion.shift == Shift(30.0, None, 2.0, "back", grows=True)
    assert Motion("rigid", thickness_mm=2.0).shift == Shift(30.0)
    with pytest.raises(CorrelationError, match="give --thickness-mm 2"):
        Motion("tension", thickness_mm=0.0)
    with pytest.raises(CorrelationError, match="give --fixed-face middle"):
        Motion("tension", fixed_face="side")


@pytest.mark.extended
def test_the_intervals_contain_the_truth_for_all_thicknesses_and_faces():
    z = []
    for seed in range(150):
        rng = np.random.default_rng([31, seed])
        around, thickness_mm = rng.uniform(0.0, 2 * np.pi), rng.uniform(0.5, 6.0)
        camera = PinholeCamera(800, 800, pan_deg=30 * np.cos(around), tilt_deg=30 * np.sin(around))
        view = View(camera, noise_px=rng.choice([0.0015, 0.004]), seed=seed)
        strain = rng.choice([rng.uniform(5e-4, 3e-3), np.exp(rng.uniform(np.log(3e-3), np.log(0.2)))])
        face = rng.choice(["middle", "back"])
        mounted_deg, tilt_deg = rng.normal(0.0, 0.1, 2), rng.normal(0.0, 0.05, 2)
        gap_mm, shift_um = rng.normal(0.0, 0.3), rng.normal(0.0, 1.0)
        nu, r = rng.uniform(0.28, 0.36), rng.uniform(0.6, 2.0)
        material = {"nu": nu, "r": r, "yield_strain": rng.uniform(0.001, 0.007)}
        pose = Pose.sloped(*(mounted_deg + tilt_deg), gap_mm)
        state = stretched(strain, thickness_mm, face, pose=pose, shift_um=shift_um, **material)
        known = None if rng.random() < 1 / 3 else face
        reference = State(Pose.sloped(*mounted_deg, gap_mm))
        found, error = corrected(state, Shift.of(1.0, None, thickness_mm, known), view, NU, reference)
        z.append(error / deviations(found))
    z = np.abs(z)
    print(f"\n{(z < 2).mean():.3f} within 2, rms {np.sqrt((z**2).mean()):.2f}, largest {z.max():.1f}")
    assert (z < 2).mean() >= 0.93
    assert (z > 4).mean() <= 0.01
