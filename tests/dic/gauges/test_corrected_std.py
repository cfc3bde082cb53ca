"""Test the standard deviations of calibrated and corrected gauges, on fields from exact geometry.

Random values are drawn for all that a calibration does not determine: the camera's position, the noise of
grid and specimen, the mounting of the specimen, and its tilt under load.
"""

import numpy as np
import pytest

from dic.gauges import Extensometer, PointGauge, StrainGauge, TransverseExtensometer
from dic.gauges.placed import PlacedGauges
from dic.out_of_plane.correction import stated
from dic.out_of_plane.shift import Shift
from dic.out_of_plane.tension import correct_tilt
from simulators.scene.optics import PinholeCamera
from simulators.scene.pose import Pose
from tests.dic.out_of_plane.exact_views import OffCentre, State, View

NU = 0.33
GAUGES = (
    Extensometer(name="axial", unit="mm", start=(0.2, -2.9), end=(0.2, 2.9), patch=1.3),
    TransverseExtensometer(name="width", unit="mm", start=(-2.9, 0.1), end=(2.9, 0.1), patch=1.0, spread=5.0),
    StrainGauge(name="area", unit="mm", centre=(0.3, -0.4), size=(5.0, 4.0), direction_deg=90.0),
    PointGauge(name="point", unit="mm", at=(1.0, 1.0), width=2.0, direction_deg=90.0),
)


def drawn(seed, *, tilting):
    """Return for each gauge its error in one random test, divided by the stated standard deviation."""
    rng = np.random.default_rng([seed, 5])
    around = rng.uniform(0.0, 2 * np.pi)
    pan, tilt = 30.0 * np.cos(around), 30.0 * np.sin(around)
    camera = PinholeCamera(800, 800, pan_deg=pan, tilt_deg=tilt)
    # `strain_std_images` does not contain the errors of the calibration.
    grid_noise_px = 0.004 if tilting else 1e-6
    view = View(OffCentre(camera, rng.normal(0.0, 8.0, 2)), grid_noise_px=grid_noise_px, seed=seed)
    strain, away = rng.choice([0.0011, 0.0022, 0.0033]), rng.uniform(0.0, 2 * np.pi)
    F = np.diag([1 - NU * strain, 1 + strain])
    mounted_deg, gap_mm = rng.normal(0.0, 0.1, 2), rng.normal(0.0, 0.3)
    slopes_deg = 0.15 * np.array([np.cos(away), np.sin(away)])
    if not tilting:
        mounted_deg, gap_mm, slopes_deg = np.zeros(2), 0.0, np.zeros(2)
    state = State(Pose.sloped(*(mounted_deg + slopes_deg), gap_mm), F)
    reference, calibration = State(Pose.sloped(*mounted_deg, gap_mm)), view.calibration()
    if not tilting:
        calibration = calibration.using("pinhole")
    (measurement,) = view.measurements([state], calibration, reference)
    correction = correct_tilt(measurement, calibration, NU, Shift(0.0))
    measurement = stated(measurement, correction)
    placed = PlacedGauges.of(GAUGES, measurement, calibration, (800, 800))
    readings = placed.read(measurement, correction)
    truth = {"axial": strain, "width": -NU * strain, "area": strain, "point": strain}
    if tilting:
        found = {name: readings[name]["corrected"] for name in truth}
        return {name: (found[name].strain - truth[name]) / found[name].strain_std for name in truth}
    found = {name: readings[name]["calibrated"] for name in truth}
    return {name: (found[name].strain - truth[name]) / found[name].strain_std_images for name in truth}


def ratios(seeds, *, tilting):
    """Return for each gauge the stated standard deviation divided by the observed one."""
    errors = [drawn(seed, tilting=tilting) for seed in seeds]
    return {name: 1.0 / np.sqrt(np.mean([one[name] ** 2 for one in errors])) for name in errors[0]}


@pytest.mark.parametrize("tilting", [False, pytest.param(True, marks=pytest.mark.extended)])
def test_stated_errors_are_of_the_size_of_those_of_drawn_tests(tilting):
    found = ratios(range(6), tilting=tilting)
    # Four gauges of six tests, which depend on each other: known to about 25 %.
    assert 0.5 < np.sqrt(np.mean(np.square(list(found.values())))) < 2.0, found


@pytest.mark.long
@pytest.mark.parametrize("tilting", [False, True])
def test_stated_errors_are_those_of_500_drawn_tests(tilting):
    found = ratios(range(1000, 1500), tilting=tilting)
    # These ratios are known to 3.2 %.
    assert {name for name, ratio in found.items() if not 0.9 < ratio < 1.1} == set(), found
