import cv2
import numpy as np
import pytest

from simulators.scene.optics import PinholeCamera

WORLD_MM = np.random.default_rng(3).uniform([-5, -5, -0.5], [5, 5, 0.5], (200, 3))


@pytest.mark.parametrize(("pan_deg", "tilt_deg"), [(0, 0), (30, 0), (0, 30), (-20, 15), (25, 25)])
@pytest.mark.parametrize("k1_per_px2", [0.0, 1e-7, -1e-8])
def test_projection_agrees_with_opencv(pan_deg, tilt_deg, k1_per_px2):
    camera = PinholeCamera(900, 700, pan_deg=pan_deg, tilt_deg=tilt_deg, k1_per_px2=k1_per_px2)
    right, up, back = camera.axes
    rotation = np.array([right, -up, -back])
    matrix = np.array([[2800.0, 0, 449.5], [0, 2800.0, 349.5], [0, 0, 1]])
    distortion = np.array([k1_per_px2 * 2800.0**2, 0, 0, 0, 0])
    expected, _ = cv2.projectPoints(
        WORLD_MM, cv2.Rodrigues(rotation)[0], -rotation @ camera.centre_mm, matrix, distortion
    )
    np.testing.assert_allclose(camera.project(WORLD_MM), expected[:, 0], atol=1e-8)


def test_pan_swings_the_camera_to_the_right_and_tilt_raises_it():
    np.testing.assert_allclose(
        PinholeCamera(900, 900, pan_deg=30).centre_mm, [20, 0, 20 * np.sqrt(3)], atol=1e-12
    )
    np.testing.assert_allclose(
        PinholeCamera(900, 900, tilt_deg=30).centre_mm, [0, 20, 20 * np.sqrt(3)], atol=1e-12
    )


def test_the_picture_is_upright_and_centred_whatever_the_direction():
    camera = PinholeCamera(900, 700, pan_deg=25, tilt_deg=-20)
    origin, to_the_right, upwards = camera.project(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]))
    np.testing.assert_allclose(origin, [449.5, 349.5], atol=1e-12)
    assert to_the_right[0] > origin[0]
    assert upwards[1] < origin[1]
    assert upwards[0] == pytest.approx(origin[0], abs=1e-9)


@pytest.mark.parametrize("k1_per_px2", [0.0, 1e-7, -1e-7])
def test_rays_lead_back_to_the_pixels_they_came_from(k1_per_px2):
    camera = PinholeCamera(900, 900, pan_deg=20, tilt_deg=10, k1_per_px2=k1_per_px2)
    px = np.random.default_rng(4).uniform(-0.5, 899.5, (500, 2))
    origin, directions = camera.ray(px)
    np.testing.assert_allclose(camera.project(origin + 37.0 * directions), px, rtol=1e-12, atol=1e-9)


def test_distortion_that_folds_the_corners_over_is_refused():
    with pytest.raises(ValueError, match="folds the image over before its corners"):
        PinholeCamera(900, 900, k1_per_px2=-1e-6)
