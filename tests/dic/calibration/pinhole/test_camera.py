import cv2
import numpy as np
import pytest

from dic.calibration.pinhole.camera import Pinhole

# OpenCV's camera looks along +Z with y down: half a turn about X from ours
HALF_TURN = np.diag([1.0, -1.0, -1.0])
LENS = np.array([4e-8, -3e-14, 2e-6, -3e-6])


def _bent(pan_deg: float, tilt_deg: float) -> Pinhole:
    """Return a camera in which all four distortion coefficients differ from 0."""
    straight = Pinhole.swung(pan_deg=pan_deg, tilt_deg=tilt_deg)
    return Pinhole(2800.0, np.array([512.0, 384.0]), LENS, straight.rotation, straight.centre_mm)


@pytest.mark.parametrize(("pan", "tilt"), [(0, 0), (30, 0), (0, -20), (30, 30), (-17, 41)])
def test_projection_agrees_with_opencv(pan: float, tilt: float) -> None:
    camera = _bent(pan_deg=pan, tilt_deg=tilt)
    points = np.random.default_rng(0).uniform(-5, 5, (50, 3)) * [1, 1, 0.1]
    pose, _ = cv2.Rodrigues(HALF_TURN @ camera.rotation)
    matrix = np.array([[2800, 0, 512], [0, 2800, 384], [0, 0, 1.0]])
    # its coefficients go with powers of the tangent, ours with powers of px
    distortion = LENS * 2800.0 ** np.array([2, 4, 1, 1])
    expected, _ = cv2.projectPoints(points, pose, np.array([0, 0, 40.0]), matrix, distortion)

    assert camera.project(points) == pytest.approx(expected[:, 0], abs=1e-8)


def test_positive_pan_brings_the_right_side_away_from_the_camera() -> None:
    right = Pinhole.swung(pan_deg=30).project(np.array([[5.0, 0], [-5, 0]]))

    assert right[0, 0] == pytest.approx(2800 * 5 * np.cos(np.pi / 6) / (40 + 5 * 0.5))
    assert right[1, 0] == pytest.approx(-2800 * 5 * np.cos(np.pi / 6) / (40 - 5 * 0.5))


def test_up_on_the_grid_is_up_in_the_image() -> None:
    assert Pinhole.swung().project(np.array([[0.0, 1.0]]))[0] == pytest.approx([0, -70])


def test_the_angle_off_axis_is_that_of_both_swings() -> None:
    assert Pinhole.swung(pan_deg=-30).off_axis_deg == pytest.approx(30)
    expected = np.degrees(np.arccos(np.cos(np.radians(25)) ** 2))
    assert Pinhole.swung(pan_deg=25, tilt_deg=25).off_axis_deg == pytest.approx(expected)


@pytest.mark.parametrize(("pan", "tilt"), [(0, 0), (30, 0), (-25, 25)])
def test_the_map_takes_every_image_point_back_to_the_plane(pan: float, tilt: float) -> None:
    camera = _bent(pan_deg=pan, tilt_deg=tilt)
    mm = np.random.default_rng(1).uniform(-6, 6, (200, 2))

    assert camera.map(camera.project(mm)) == pytest.approx(mm, abs=1e-10)


def test_the_jacobian_is_the_slope_of_the_map() -> None:
    camera = _bent(pan_deg=30, tilt_deg=-10)
    px = np.random.default_rng(2).uniform(100, 800, (20, 2))
    half = 0.01
    by_x, by_y = (
        (camera.map(px + step) - camera.map(px - step)) / (2 * half)
        for step in (np.array([half, 0]), np.array([0, half]))
    )

    assert camera.jacobian(px) == pytest.approx(np.stack([by_x, by_y], axis=-1), rel=1e-7, abs=1e-9)


def test_rays_run_from_the_pinhole_through_everything_that_is_seen_there() -> None:
    camera = _bent(pan_deg=20, tilt_deg=15)
    points = np.random.default_rng(3).uniform(-4, 4, (50, 3))
    rays = camera.rays(camera.project(points))
    towards = points - camera.centre_mm

    assert rays == pytest.approx(towards / np.linalg.norm(towards, axis=1, keepdims=True), abs=1e-12)
    assert (rays[:, 2] < 0).all()


def test_what_no_lens_shows_is_not_a_number() -> None:
    barrel = Pinhole.swung(k1_per_px2=-1e-7)
    # r·(1 + k1·r²) rises to 2/3·√(1/(3·|k1|)) = 1217 px only
    px = np.array([[1200.0, 0.0], [1230.0, 0.0], [np.nan, 0.0]])

    assert np.isfinite(barrel.map(px)).tolist() == [[True, True], [False, False], [False, False]]
    assert np.isfinite(barrel.jacobian(px)).all(axis=(1, 2)).tolist() == [True, False, False]
    assert np.isfinite(barrel.rays(px)).all(axis=1).tolist() == [True, False, False]
    # at 1825.7 px the lens folds the image over
    mm = np.array([[1800.0, 0], [1850.0, 0]]) * 40 / 2800
    assert np.isfinite(barrel.project(mm)).all(axis=1).tolist() == [True, False]


def test_what_lies_behind_the_camera_is_not_seen_and_the_sky_is_not_on_the_plane() -> None:
    camera = Pinhole.swung(pan_deg=60)

    assert np.isnan(camera.project(np.array([[0.0, 0.0, 100.0]]))).all()
    # its axis is 60° from the plane's normal: 30° further the rays no longer meet the plane
    assert np.isfinite(camera.map(np.array([[2800 * np.tan(np.radians(29)), 0.0]]))).all()
    assert np.isnan(camera.map(np.array([[2800 * np.tan(np.radians(31)), 0.0]]))).all()
