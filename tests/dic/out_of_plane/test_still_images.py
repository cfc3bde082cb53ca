"""Tests of the errors that still images show, with exact geometry, noise, haze and a warming camera."""

from dataclasses import replace

import numpy as np
import pytest

from dic.out_of_plane.correction import points_of
from dic.out_of_plane.shift import Shift
from dic.out_of_plane.still_images import still_errors
from dic.out_of_plane.tension import correct_tilt
from dic.strain.measurement import measure
from dic.strain.still import StillErrors, orthogonal_polynomials
from simulators.scene.optics import PinholeCamera
from simulators.scene.pose import Pose
from tests.dic.out_of_plane.exact_views import State, View, deviations, strains

NU = 0.33
WAVES = 24


def haze(rng, x_px, y_px, wave_px, rms_px):
    """Return a smooth random field of displacements, shape (2, rows, columns), as a sum of waves."""
    kx, ky = rng.normal(0.0, 1.0 / wave_px, (2, WAVES))
    phases = rng.uniform(0.0, 2 * np.pi, (2, WAVES))
    turns = kx * x_px[..., None] + ky * y_px[..., None]
    return rms_px * np.sqrt(2.0 / WAVES) * np.array([np.cos(turns + phase).sum(axis=-1) for phase in phases])


def moved(measurement, calibration, by_px):
    """Return a measurement whose displacements differ by (2, rows, columns) px."""
    warps = measurement.field.warps.copy()
    warps[..., 0] += by_px[0]
    warps[..., 3] += by_px[1]
    return measure(replace(measurement.field, warps=warps), calibration)


def scaled(measurement, share):
    """Return the displacements of an image that a warming camera magnifies by 1 + `share`."""
    x_px, y_px = np.meshgrid(measurement.field.x_px, measurement.field.y_px)
    return share * np.array([x_px - 400.0, y_px - 400.0])


def view_of(seed):
    around = np.random.default_rng([3, seed]).uniform(0.0, 2 * np.pi)
    camera = PinholeCamera(800, 800, pan_deg=30 * np.cos(around), tilt_deg=30 * np.sin(around))
    return View(camera, noise_px=0.002, seed=seed)


@pytest.fixture(scope="module")
def quiet():
    """Three still images with noise alone, and their calibration."""
    view = view_of(1)
    calibration = view.calibration()
    return view.measurements([State()] * 3, calibration), calibration


def test_noise_is_no_error(quiet):
    stills, calibration = quiet
    found = still_errors(
        [(still, float(k)) for k, still in enumerate(stills, 1)], calibration, in_seconds=True
    )
    assert found.drift_mm == ()
    points = points_of(stills[0], calibration)
    weights = np.zeros((len(points.before_mm), 2, 1))
    weights[:, 0, 0] = orthogonal_polynomials(points.before_mm)[:, 1] / len(points.before_mm)
    by_noise = points.noise_covariance(weights) + points.smooth_covariance(weights, 3)
    assert found.covariance(points.before_mm, weights)[0, 0] < 0.2 * by_noise[0, 0]
    assert "no errors beyond the noise" in replace(found, scatter_mm2=(0.0, 0.0, 0.0)).text(0.014)


def test_clear_errors_have_the_variance_of_students_distribution(quiet):
    stills, calibration = quiet
    # exx and eyy of 100 µε: the sum of squares of three coefficients over 3 - 2 degrees of freedom
    share = 1e-4
    still = moved(stills[0], calibration, scaled(stills[0], share))
    found = still_errors([(still, np.nan)], calibration, in_seconds=False)
    points = points_of(still, calibration)
    rms_mm = share * (points.before_mm - points.before_mm.mean(axis=0)).std(axis=0)
    assert found.scatter_mm2[0] == pytest.approx((rms_mm**2).sum(), rel=0.1)
    assert found.drift_mm == ()


def test_a_drift_is_told_from_scatter_and_grows_with_the_time(quiet):
    stills, calibration = quiet
    drifting = [(moved(s, calibration, scaled(s, 1e-4 * k)), float(k)) for k, s in enumerate(stills, 1)]
    found = still_errors(drifting, calibration, in_seconds=True)
    points = points_of(stills[0], calibration)
    rms_mm = 1e-4 * (points.before_mm - points.before_mm.mean(axis=0)).std(axis=0)
    assert found.drift_mm[:2] == pytest.approx(rms_mm, rel=0.1)
    assert np.array(found.at(7.0).drift_mm) == pytest.approx(7.0 * np.array(found.drift_mm))
    assert np.array(found.at(7.0).drift_mm2) == pytest.approx(49.0 * np.array(found.drift_mm2))
    assert "and a drift" in found.text(calibration.mm_per_px)
    scatter = [
        (moved(s, calibration, scaled(s, x)), float(k))
        for k, (s, x) in enumerate(zip(stills, (2e-4, -3e-4, 1e-4), strict=True), 1)
    ]
    assert still_errors(scatter, calibration, in_seconds=True).drift_mm == ()


def test_errors_survive_json(quiet):
    found = StillErrors(2, (1e-9, 1e-10, 0.0), (1e-6,) * 17, (1e-14,) * 17, True, 1e-5)
    assert StillErrors.from_dict(found.as_dict()) == found
    assert StillErrors.from_dict(None) is None


def z_of(seed, kind, images):
    """Return the errors of exx, eyy, exy of a random test, divided by their standard deviations."""
    rng, view = np.random.default_rng([7, seed]), view_of(seed)
    calibration, strain = view.calibration(), rng.uniform(5e-4, 3e-3)
    loaded = State(Pose.sloped(*rng.normal(0.0, 0.05, 2)), np.diag([1 - NU * strain, 1 + strain]))
    every = view.measurements([State()] * images + [loaded], calibration)
    x_px, y_px = np.meshgrid(every[0].field.x_px, every[0].field.y_px)
    if kind == "haze":
        first, *others = (haze(rng, x_px, y_px, 400.0, 0.01) for _ in range(images + 2))
        errors = [each - first for each in others]
    else:
        # 100 ppm at the loaded image, which is the tenth
        errors = [scaled(every[0], 1e-5 * k) for k in (*range(1, images + 1), 10)]
    *stills, last = (moved(m, calibration, error) for m, error in zip(every, errors, strict=True))
    found = still_errors([(s, float(k)) for k, s in enumerate(stills, 1)], calibration, in_seconds=True)
    last = last if found is None else replace(last, still=found.at(10.0))
    corrected = correct_tilt(last, calibration, NU, Shift(0.0))
    return (strains(corrected) - view.true_strain(last, loaded)) / deviations(corrected)


@pytest.mark.extended
@pytest.mark.parametrize(("kind", "images"), [("haze", 1), ("haze", 2), ("warm", 2), ("warm", 4)])
def test_the_intervals_contain_the_truth(kind, images):
    z = np.abs([z_of(seed, kind, images) for seed in range(50)])
    print(f"\n{kind}: {(z < 2).mean():.3f} within 2, rms {np.sqrt((z**2).mean()):.2f}, largest {z.max():.1f}")
    assert (z < 2).mean() >= 0.93
    assert (z > 4).mean() <= 0.01


def test_without_still_images_haze_is_not_seen():
    z = np.abs([z_of(seed, "haze", 0) for seed in range(6)])
    assert (z > 2).mean() > 0.1
