import cv2
import numpy as np
import pytest

from dic.pinhole import PinholeCamera


@pytest.mark.parametrize(("pan", "tilt"), [(0, 0), (30, 0), (0, -20), (30, 30), (-17, 41)])
def test_projection_agrees_with_opencv(pan: float, tilt: float) -> None:
    camera = PinholeCamera(2800, 40, pan, tilt, 3e-8, (512.0, 384.0))
    points = np.random.default_rng(0).uniform(-5, 5, (50, 3)) * [1, 1, 0.1]
    # OpenCV's camera looks along +Z with y down: half a turn about X from ours
    half_turn = np.diag([1.0, -1.0, -1.0])
    pose, _ = cv2.Rodrigues(half_turn @ camera.rotation)
    matrix = np.array([[2800, 0, 512], [0, 2800, 384], [0, 0, 1.0]])
    # its k1 is per squared tangent, ours per squared pixel
    distortion = np.array([3e-8 * 2800**2, 0, 0, 0, 0])
    expected, _ = cv2.projectPoints(points, pose, np.array([0, 0, 40.0]), matrix, distortion)

    assert camera.project(points) == pytest.approx(expected[:, 0], abs=1e-8)


def test_positive_pan_brings_the_right_side_away_from_the_camera() -> None:
    right = PinholeCamera(pan_deg=30).project(np.array([[5.0, 0], [-5, 0]]))

    assert right[0, 0] == pytest.approx(2800 * 5 * np.cos(np.pi / 6) / (40 + 5 * 0.5))
    assert right[1, 0] == pytest.approx(-2800 * 5 * np.cos(np.pi / 6) / (40 - 5 * 0.5))


def test_up_on_the_grid_is_up_in_the_image() -> None:
    assert PinholeCamera().project(np.array([[0.0, 1.0]]))[0] == pytest.approx([0, -70])
