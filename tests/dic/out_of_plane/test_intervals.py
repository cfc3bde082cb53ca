"""The confidence intervals of corrected strains contain the true strains as often as stated.

In each trial, random values are drawn for all that a calibration does not determine: the principal point, the
direction of view, the noise of grid and specimen, and the misalignment.
"""

import numpy as np
import pytest

from dic.out_of_plane.rigidity import correct_rotation
from dic.out_of_plane.shift import Shift
from dic.out_of_plane.tension import correct_tilt
from dic.out_of_plane.two_cameras import correct_with_two_cameras
from simulators.scene.optics import PinholeCamera
from simulators.scene.pose import Pose
from simulators.scene.scene import Misalignment
from tests.dic.out_of_plane.exact_views import OffCentre, PrintedGrid, State, View, deviations, strains

NU = 0.33


def unit(angle):
    return np.array([np.cos(angle), np.sin(angle)])


def view_from(rng, off_axis_deg, seed, half_mm=4.2, grid=None):
    pan, tilt = off_axis_deg * unit(rng.uniform(0, 2 * np.pi))
    camera = PinholeCamera(800, 800, pan_deg=pan, tilt_deg=tilt)
    # 1 % of the width, as a calibration expects.
    return View(OffCentre(camera, rng.normal(0.0, 8.0, 2)), seed=seed, half_mm=half_mm, grid=grid)


def stretched(rng):
    strain = rng.choice([0.0, 0.0011, 0.0022, 0.0033])
    return np.diag([1 - NU * strain, 1 + strain])


def rotated(seed, grid=None, bow_um=0.0):
    rng = np.random.default_rng([seed, 1])
    view = view_from(rng, 30, seed, half_mm=3.4, grid=grid)
    wobble, grid = 0.2 * unit(rng.uniform(0, 7)), rng.uniform(0, 0.1) * unit(rng.uniform(0, 7))
    misalignment = Misalignment(
        axis_slope_x_deg=wobble[0],
        axis_slope_y_deg=wobble[1],
        grid_slope_x_deg=grid[0],
        grid_slope_y_deg=grid[1],
        axis_x_mm=rng.normal(0, 0.3),
        axis_y_mm=rng.normal(0, 0.3),
    )
    mounted, calibration = misalignment.mounted(), view.calibration()
    # Height at 5 mm from the middle.
    curvatures = tuple(rng.normal(0.0, 2e-3 * bow_um / 25, 3))
    poses = [mounted, *(mounted.after(misalignment.turned(angle)) for angle in np.arange(1, 9) * 45.0)]
    reference, *states = (State(pose, curvatures=curvatures) for pose in poses)
    found = correct_rotation(view.measurements(states, calibration, reference), calibration)
    slopes = np.concatenate([found.alignment.wobble_deg, np.degrees(np.arctan(found.alignment.slopes[:2]))])
    slope_std = [found.alignment.wobble_std_deg, np.degrees(np.sqrt(np.diag(found.alignment.covariance)[:2]))]
    z_slopes = (slopes - np.concatenate([wobble, grid])) / np.concatenate(slope_std)
    return np.array([strains(c) / deviations(c) for c in found.corrections]).ravel(), z_slopes


def tilted(seed, grid=None):
    rng = np.random.default_rng([seed, 2])
    view, slopes_deg = view_from(rng, 30, seed, grid=grid), 0.15 * unit(rng.uniform(0, 7))
    mounted_deg, gap_mm = rng.normal(0.0, 0.1, 2), rng.normal(0.0, 0.3)
    state = State(Pose.sloped(*(mounted_deg + slopes_deg), gap_mm), stretched(rng))
    reference, calibration = State(Pose.sloped(*mounted_deg, gap_mm)), view.calibration()
    (measurement,) = view.measurements([state], calibration, reference)
    found = correct_tilt(measurement, calibration, NU, Shift(0.0))
    slopes = np.array([found.after.slope_x, found.after.slope_y])
    z_slopes = (slopes - np.tan(np.radians(slopes_deg))) / found.after_std[:2]
    return (strains(found) - view.true_strain(measurement, state)) / deviations(found), z_slopes


def seen_twice(seed, grid=None):
    rng = np.random.default_rng([seed, 3])
    views = view_from(rng, 30, 2 * seed, grid=grid), view_from(rng, 0, 2 * seed + 1, grid=grid)
    slopes_deg, shift_mm = 0.15 * unit(rng.uniform(0, 7)), rng.uniform(-0.02, 0.02)
    state = State(Pose.sloped(*slopes_deg, shift_mm), stretched(rng))
    calibrations = tuple(v.calibration() for v in views)
    seen = tuple(v.measurements([state], c)[0] for v, c in zip(views, calibrations, strict=True))
    found = correct_with_two_cameras(seen, calibrations)
    truth = np.array([*np.tan(np.radians(slopes_deg)), shift_mm])
    plane = np.array([found.plane.slope_x, found.plane.slope_y, found.plane.shift_mm])
    true_strain = views[0].true_strain(seen[0], state)
    return (strains(found) - true_strain) / deviations(found), (plane - truth) / found.plane_std


def aligned(seed):
    rng = np.random.default_rng([seed, 4])
    view = view_from(rng, 30, seed)
    state, calibration = State(F=stretched(rng)), view.calibration()
    (measurement,) = view.measurements([state], calibration)
    found = correct_tilt(measurement, calibration, NU, Shift(0.0))
    return (strains(found) - view.true_strain(measurement, state)) / deviations(found), found.after_std * 0


CAMPAIGNS = [*(pytest.param(drawn, marks=pytest.mark.extended) for drawn in (rotated, tilted)), seen_twice]


@pytest.mark.parametrize("campaign", CAMPAIGNS)
def test_errors_are_of_the_size_that_intervals_say(campaign):
    # A rotation has eight images.
    trials = range(4 if campaign is rotated else 8)
    strain, plane = (np.concatenate(z) for z in zip(*map(campaign, trials), strict=True))
    assert 0.4 < np.sqrt(np.mean(strain**2)) < 1.5
    assert 0.4 < np.sqrt(np.mean(plane**2)) < 1.5


@pytest.mark.extended
def test_a_correction_gives_an_aligned_specimen_no_bias_of_its_own():
    z = np.array([aligned(seed)[0] for seed in range(20)])
    # The mean of twenty lies within 3 of its own standard deviations.
    assert (np.abs(z.mean(axis=0)) < 3 / np.sqrt(len(z))).all()


@pytest.mark.long
@pytest.mark.parametrize("campaign", CAMPAIGNS)
def test_the_intervals_hold_the_truth_as_often_as_they_say(campaign):
    strain, plane = (np.array(z) for z in zip(*map(campaign, range(100)), strict=True))
    inside = (np.abs(strain) < 1.96).mean()
    of_plane = (np.abs(plane) < 1.96).mean(axis=0)
    print(f"\n{campaign.__name__}: strain inside {inside:.3f}, plane {of_plane.round(3)}")
    assert 0.90 <= inside <= 0.99
    assert ((of_plane >= 0.88) & (of_plane <= 1.0)).all()


def test_a_bowed_specimen_is_rotated_without_false_strain():
    """Bows of 10 µm over ±5 mm; alone the false strain is ten standard deviations."""
    z = np.concatenate([rotated(seed, bow_um=10.0)[0] for seed in range(2)])
    assert (np.abs(z) < 4).all()
    assert np.sqrt(np.mean(z**2)) < 1.6


def on_printed_grids(campaign, trials):
    """Return z of strains with grids that are drawn anew for each trial."""
    grids = [PrintedGrid.drawn(np.random.default_rng([seed, 77])) for seed in trials]
    return np.concatenate(
        [np.ravel(campaign(seed, grid)[0]) for seed, grid in zip(trials, grids, strict=True)]
    )


@pytest.mark.parametrize(
    "campaign",
    [
        pytest.param(rotated, marks=pytest.mark.extended),
        tilted,
        pytest.param(seen_twice, marks=pytest.mark.extended),
    ],
)
def test_a_printed_grid_is_in_the_intervals(campaign):
    z = on_printed_grids(campaign, range(4))
    assert (np.abs(z) < 4).all()
    assert 0.3 < np.sqrt(np.mean(z**2)) < 1.6


@pytest.mark.long
@pytest.mark.parametrize("campaign", [rotated, tilted, seen_twice])
def test_intervals_on_printed_grids_hold_the_truth(campaign):
    z = np.abs(on_printed_grids(campaign, range(60)))
    print(f"\n{campaign.__name__}: within 2: {(z < 2).mean():.3f}, beyond 4: {(z > 4).mean():.4f}")
    # The strains of one rotation are errors of one grid together: 60 grids give this share within 2 %.
    assert (z < 2).mean() >= 0.92
    assert (z > 4).mean() <= 0.01
