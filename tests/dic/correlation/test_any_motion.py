"""Images that are rotated, scaled or seen off-axis are correlated without a hint."""

import numpy as np
import pytest

from dic.correlation.correlator import Correlator
from dic.correlation.settings import CorrelationSettings

SIDE_PX = 320
TURNS_DEG = np.arange(0.0, 360.0, 7.5)
SCALES = (0.8, 0.9, 1.0, 1.1, 1.2)
SAMPLE = (7.5, 67.5, 127.5, 180.0, 247.5, 322.5)


def off_axis_view(turn_deg, scale, off_axis_deg=30.0, towards_deg=0.0):
    """Return the homography of a plane that is turned about the centre and then seen by an off-axis camera.

    The focal length is four image widths, as in the paper: 2800 px for an image of 10 mm that is 700 px wide.
    """
    t, w, f = np.radians(turn_deg), np.radians(towards_deg), 4.0 * SIDE_PX
    turn = np.array([[np.cos(t), np.sin(t), 0], [-np.sin(t), np.cos(t), 0], [0, 0, 1]])
    axis = np.array([[np.cos(w), -np.sin(w), 0], [np.sin(w), np.cos(w), 0], [0, 0, 1]])
    a = np.radians(off_axis_deg)
    swing = np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])
    rotation = axis @ swing @ axis.T @ turn
    pose = np.column_stack([scale * rotation[:, 0], scale * rotation[:, 1], [0, 0, f]])
    to_centre = np.eye(3)
    to_centre[:2, 2] = -(SIDE_PX - 1) / 2
    return np.linalg.inv(to_centre) @ np.diag([f, f, 1.0]) @ pose @ to_centre


def seen(homography, x, y):
    at = homography @ np.stack([np.ravel(x), np.ravel(y), np.ones(np.size(x))])
    return (at[0] / at[2]).reshape(np.shape(x)), (at[1] / at[2]).reshape(np.shape(x))


@pytest.fixture(scope="module")
def pattern(speckle):
    return speckle(seed=31, shape=(SIDE_PX, SIDE_PX), margin=120, noise=2.0)


@pytest.fixture(scope="module")
def correlator(pattern):
    # Perspective bends what affine shape functions take for straight: by up to 0.07 px in such subsets.
    return Correlator(
        pattern.draw(noise_seed=1), settings=CorrelationSettings(subset_px=31, step_px=8, shape="quadratic")
    )


def share_within_twentieth_of_a_pixel(correlator, pattern, homography):
    back = np.linalg.inv(homography)
    field = correlator.correlate(pattern.draw(lambda x, y: seen(back, x, y), noise_seed=2))
    x, y = np.meshgrid(field.x_px.astype(float), field.y_px.astype(float))
    true_x, true_y = seen(homography, x, y)
    error = np.hypot(x + field.u_px - true_x, y + field.v_px - true_y)
    # The corners of the subset, as the truth has them, stay 4 px away from the edge of the image.
    corners = np.array([seen(homography, x + i, y + j) for i in (-15, 15) for j in (-15, 15)])
    in_view = field.active & (corners.min(axis=(0, 1)) >= 4) & (corners.max(axis=(0, 1)) <= SIDE_PX - 5)
    assert in_view.sum() > 500
    return np.count_nonzero(error[in_view] < 0.05) / in_view.sum()


@pytest.mark.parametrize(
    "turn_deg",
    [SAMPLE[2], *(pytest.param(deg, marks=pytest.mark.extended) for deg in SAMPLE if deg != SAMPLE[2])],
)
def test_turned_and_seen_from_aside(correlator, pattern, turn_deg):
    scale = SCALES[SAMPLE.index(turn_deg) % len(SCALES)]
    view = off_axis_view(turn_deg, scale, towards_deg=3 * turn_deg)
    assert share_within_twentieth_of_a_pixel(correlator, pattern, view) >= 0.99


@pytest.mark.long
@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize("turn_deg", TURNS_DEG)
def test_every_turn_at_every_scale_seen_from_aside(correlator, pattern, turn_deg, scale):
    view = off_axis_view(turn_deg, scale, towards_deg=3 * turn_deg + 72 * SCALES.index(scale))
    assert share_within_twentieth_of_a_pixel(correlator, pattern, view) >= 0.99
