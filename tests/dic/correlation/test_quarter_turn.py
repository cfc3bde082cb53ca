"""An image turned by 90°, 180° or 270° gives the same displacement field as the unturned image."""

import numpy as np
import pytest

from dic.correlation.correlator import Correlator
from dic.correlation.quarter_turn import quarters_of, turn_std, turn_warps
from dic.correlation.settings import CorrelationSettings

SHAPE = (200, 260)
MARGIN_PX = 30
"""Width in px of the edge of the smaller image in which the spline differs, because its neighbours differ."""


def place_after(quarters, x, y, shape):
    """Return the place to which `numpy.rot90` moves the pixel (x, y), found in a turned array of numbers."""
    turned = np.rot90(np.arange(shape[0] * shape[1]).reshape(shape), quarters)
    row, column = np.argwhere(turned == y * shape[1] + x)[0]
    return column, row


@pytest.mark.parametrize("quarters", [0, 1, 2, 3])
def test_a_turned_warp_leads_where_rot90_takes_the_pixel(quarters):
    """A whole subset of pixels, seen through a warp with gradients and curvature that hits whole pixels."""
    warp = np.array([3.0, 1.0, -1.0, 2.0, 1.0, 0.0, 2.0, 1.0, 0.0, 0.0, -1.0, 2.0])
    x, y, shape = np.array(20), np.array(17), (60, 75)
    turned = turn_warps(warp, x, y, shape, quarters)
    for dx, dy in ((0, 0), (1, 0), (0, 1), (2, -1), (-3, 2)):
        monomials = np.array([1, dx, dy]), np.array([dx * dx / 2, dx * dy, dy * dy / 2])

        def seen(p, dx=dx, dy=dy, monomials=monomials):
            first, second = monomials
            u, v = p[0:3] @ first + p[6:9] @ second, p[3:6] @ first + p[9:12] @ second
            return x + dx + u, y + dy + v

        to_x, to_y = seen(warp)
        assert seen(turned) == pytest.approx(place_after(quarters, int(to_x), int(to_y), shape))
    back = turn_warps(turned, x, y, np.rot90(np.empty(shape), quarters).shape, -quarters)
    np.testing.assert_allclose(back, warp, atol=1e-12)


def test_the_nearest_quarter_is_chosen():
    for angle_deg, quarters in (
        (0, 0),
        (44, 0),
        (-44, 0),
        (46, 1),
        (90, 1),
        (134, 1),
        (180, 2),
        (226, 3),
        (-90, 3),
    ):
        # x towards y, which points down: rot90 turns the other way, and so back.
        c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
        warps = np.array([[5.0, c - 1, -s, 3.0, s, c - 1], [np.nan] * 6])
        assert quarters_of(warps) == quarters
    assert quarters_of(np.full((3, 6), np.nan)) == 0


def test_an_odd_turn_exchanges_the_std_of_u_and_v():
    std = np.arange(6.0)
    np.testing.assert_array_equal(turn_std(std, 2), std)
    np.testing.assert_array_equal(turn_std(std, 3), [3, 4, 5, 0, 1, 2])


@pytest.fixture(scope="module")
def pair(speckle):
    pattern = speckle(seed=71, shape=SHAPE, noise=1.0)

    def back(x, y):
        return x - 1.3 - 0.004 * (y - 90), y + 0.7 + 0.006 * (x - 120)

    return pattern.draw(noise_seed=1), pattern.draw(back, noise_seed=2)


def turned_in_frame(image, quarters):
    """Return the image after `numpy.rot90`, in its original shape, and the homography of its pixels.

    For odd numbers of quarter turns the image is cut at the right and filled up below before the turn, so
    that the turned image has the original shape.
    """
    format_before = image.shape if quarters % 2 == 0 else image.shape[::-1]
    upright = np.full(format_before, image.mean(), np.float32)
    rows, columns = np.minimum(image.shape, format_before)
    upright[:rows, :columns] = image[:rows, :columns]
    motion, (height, width) = np.eye(3), format_before
    for _ in range(quarters):
        motion = np.array([[0, 1, 0], [-1, 0, width - 1], [0, 0, 1.0]]) @ motion
        height, width = width, height
    return np.rot90(upright, quarters), motion


@pytest.mark.parametrize("shape", ["affine", "quadratic"])
@pytest.mark.parametrize("quarters", [1, 2, 3])
def test_a_turned_picture_gives_the_field_of_the_unturned_one(pair, quarters, shape):
    reference, deformed = pair
    # Iterated to the end, or a start from another neighbour would show.
    settings = CorrelationSettings(subset_px=21, step_px=8, shape=shape, tolerance_px=1e-6)
    correlator = Correlator(reference, settings=settings)
    expected = correlator.correlate(deformed)
    framed, motion = turned_in_frame(deformed, quarters)
    found = correlator.correlate(framed, hint=motion)
    assert found.start == "hint"
    here = np.stack(np.meshgrid(expected.x_px, expected.y_px), axis=-1)
    there = here + np.stack([expected.u_px, expected.v_px], axis=-1)
    there = there @ motion[:2, :2].T + motion[:2, 2]
    edges = MARGIN_PX, np.array(SHAPE[::-1]) - MARGIN_PX
    inner = expected.converged
    for place in (here, there):
        inner &= ((place > edges[0]) & (place < edges[1])).all(axis=-1)
    assert inner.sum() > 150
    assert found.converged[inner].all()
    moved = here + np.stack([found.u_px, found.v_px], axis=-1)
    assert np.abs(moved - there)[inner].max() < 1e-6
    turn = motion[:2, :2]
    gradients = [f.gradient[inner].reshape(-1, 2, 2) + np.eye(2) for f in (expected, found)]
    assert np.abs(gradients[1] - turn @ gradients[0]).max() < 1e-6
    stated = [np.stack([f.std_u_px, f.std_v_px], axis=-1)[inner] for f in (expected, found)]
    np.testing.assert_allclose(stated[1], stated[0] @ np.abs(turn).T, rtol=1e-3)
