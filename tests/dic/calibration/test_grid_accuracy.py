"""Deviations of a grid from its nominal shape follow from images that see it differently."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from dic.calibration import Calibration, GridAccuracy, KnownCamera
from dic.calibration.one_grid import of_one_grid
from dic.calibration.turned import in_axes_of_first
from dic.errors import CalibrationError
from dic.targets.points import GridPoints
from tests.dic.out_of_plane.exact_views import PrintedGrid

GRID = PrintedGrid(scale_ratio=8e-4, skew_rad=-4e-4, bow_mm=(0.02, -0.01, 0.03))
TRUTH = np.array([8e-4, -4e-4, 0.02, -0.01, 0.03])
SHAPE = (900, 1000)
MATRIX = np.array([[2800.0, 0.0, 503.0], [0.0, 2800.0, 447.0], [0.0, 0.0, 1.0]])
POSES = [(0.0, 28.0), (25.0, 0.0), (-20.0, -15.0), (0.0, -30.0)]


def seen(rng, around_x_deg, around_y_deg, turned=False, grid=GRID):
    """The grid's points in an image, with noise of 0.01 px, as a target without a mark is found."""
    index = np.stack(np.meshgrid(np.arange(21), np.arange(21)), axis=-1).reshape(-1, 2)
    tilt = cv2.Rodrigues(np.radians([around_x_deg, around_y_deg, 0.0]))[0] @ np.diag([1.0, -1.0, -1.0])
    if turned:
        tilt = tilt @ cv2.Rodrigues(np.array([0.0, 0.0, np.pi / 2]))[0]
    places = grid.places_mm((index - 10) * 0.5)
    px, _ = cv2.projectPoints(places, cv2.Rodrigues(tilt)[0], np.array([0.4, -0.2, 40.0]), MATRIX, None)
    noisy = px[:, 0] + rng.normal(0.0, 0.01, (len(index), 2))
    # X of the found grid is the direction to the image's right, which is −Y of a grid that is turned.
    found = np.column_stack([20 - index[:, 1], index[:, 0]]) if turned else index
    return GridPoints.on_lattice(found, noisy, (21, 21), 0.5)


def z_of(pinhole):
    std = np.sqrt(np.diag(pinhole.deviation_covariance))
    return (pinhole.deviations - TRUTH) / std, std


@pytest.mark.parametrize("turned", [False, True])
def test_images_of_the_tilted_grid_show_its_deviations(turned):
    rng = np.random.default_rng(1)
    grids = [seen(rng, *pose, turned=turned and k == 1) for k, pose in enumerate(POSES)]
    made = GridAccuracy()
    calibration = Calibration.fit(in_axes_of_first(grids, SHAPE, None, made), SHAPE, accuracy=made)
    z, std = z_of(calibration.pinhole)
    assert (np.abs(z) < 3.5).all()
    assert (std < np.array([5e-5, 5e-5, 1e-3, 1e-3, 1e-3])).all()
    assert calibration.pinhole.focal_px == pytest.approx(2800.0, abs=4 * calibration.pinhole.focal_std_px)


def test_two_cameras_tell_each_other_what_they_see_of_the_grid():
    rng = np.random.default_rng(2)
    alone = [
        Calibration.fit(seen(rng, *pose), SHAPE, accuracy=GridAccuracy()) for pose in (POSES[0], (0.0, 1.0))
    ]
    together = of_one_grid(tuple(alone))
    z, std = z_of(together[0].pinhole)
    assert (np.abs(z) < 3.5).all()
    assert (std <= z_of(alone[0].pinhole)[1] * 1.001).all()
    assert std[0] < 0.5 * z_of(alone[0].pinhole)[1][0]
    assert np.array_equal(together[0].pinhole.deviations, together[1].pinhole.deviations)


def test_a_far_principal_point_of_one_camera_is_possible_for_the_other():
    """A camera that looks straight at the grid does not see its own, here 60 px off."""
    rng = np.random.default_rng(4)
    flat = PrintedGrid(0.0, 0.0, (0.0, 0.0, 0.0))
    grids = [seen(rng, *pose, grid=flat) for pose in (POSES[0], (0.0, 0.0))]
    moved = [replace(grid, uv_px=grid.uv_px + 60.0) for grid in grids]
    alone = tuple(Calibration.fit(grid, SHAPE, accuracy=GridAccuracy()) for grid in moved)
    together = of_one_grid(alone)
    pose = np.diag([1.0, -1.0, -1.0])
    after = together[1].pinhole
    assert (np.abs(after.centre_mm + pose.T @ [0.4, -0.2, 40.0]) < 3 * after.centre_std_mm).all()
    assert together[1].fitted_to.known.principal_std_px > 50


def test_a_stated_principal_point_stays_beside_a_far_one():
    rng = np.random.default_rng(4)
    flat = PrintedGrid(0.0, 0.0, (0.0, 0.0, 0.0))
    far, near = (seen(rng, *pose, grid=flat) for pose in (POSES[0], (0.0, 0.0)))
    stated = KnownCamera(principal_px=np.array([(SHAPE[1] - 1) / 2, (SHAPE[0] - 1) / 2]))
    alone = (
        Calibration.fit(replace(far, uv_px=far.uv_px + 60.0), SHAPE, accuracy=GridAccuracy()),
        Calibration.fit(near, SHAPE, known=stated, accuracy=GridAccuracy()),
    )
    assert of_one_grid(alone)[1].fitted_to.known is stated


def test_a_calibration_is_fitted_again_for_another_accuracy():
    grid = seen(np.random.default_rng(3), *POSES[0])
    printed, exact = (
        Calibration.fit(grid, SHAPE, accuracy=GridAccuracy(made)) for made in ("printed", "exact")
    )
    assert exact.fitted_again(accuracy=GridAccuracy()).pinhole.centre_mm == pytest.approx(
        printed.pinhole.centre_mm
    )
    # What this grid really has, counts as a remainder of the lens if the grid is said to be exact.
    assert printed.pinhole.centre_std_mm[1] > 1.3 * exact.pinhole.centre_std_mm[1]


def test_impossible_accuracies_are_refused_together():
    with pytest.raises(CalibrationError) as error:
        GridAccuracy("gold", skew_std=0.5)
    assert "one of printed, glass, exact, got gold" in str(error.value)
    assert "--skew-std" in str(error.value)
