"""The material beyond a hole, a crack or an edge does not affect the displacement of a point."""

import numpy as np
import pytest

from dic.correlation.correlator import Correlator
from dic.correlation.settings import CorrelationSettings

SMALL = CorrelationSettings(subset_px=21, step_px=5, shape="affine")
CRACK_Y = 80
TIP_X = 130.0


def opening(x):
    """Return half of the crack's opening, px: 4 px at the left edge, decreasing smoothly to 0 at the tip."""
    return 4.0 * np.clip((TIP_X - x) / TIP_X, 0, None) ** 2


def cracked(x, y):
    upper = y < CRACK_Y
    return x, np.where(upper, y + opening(x), y - opening(x))


@pytest.fixture(scope="module")
def crack(speckle):
    """The reference and deformed image of a plate with an opening crack, and the region without the crack."""
    pattern = speckle(seed=41, noise=1.0)
    deformed = pattern.draw(cracked, noise_seed=2)
    y, x = np.mgrid[: pattern.shape[0], : pattern.shape[1]]
    deformed[np.abs(y - CRACK_Y) < opening(x)] = 20.0
    region = np.ones(pattern.shape, bool)
    region[CRACK_Y, : int(TIP_X)] = False
    return pattern.draw(noise_seed=1), deformed, region


def test_a_crack_does_not_smear(crack):
    reference, deformed, region = crack
    field = Correlator(reference, region, SMALL).correlate(deformed)
    x, y = np.meshgrid(field.x_px, field.y_px)
    truth = np.where(y < CRACK_Y, -opening(x), opening(x))
    lips = field.active & (np.abs(y - CRACK_Y) <= 12) & (x < TIP_X - 10)
    assert lips.sum() > 30
    assert field.converged[lips].mean() > 0.97
    # The crack's faces curve within a subset, which an affine shape function leaves out: at most 0.02 px.
    np.testing.assert_allclose(field.v_px[lips & field.converged], truth[lips & field.converged], atol=0.1)
    np.testing.assert_allclose(field.u_px[lips & field.converged], 0.0, atol=0.1)


def test_without_a_mask_a_crack_does_smear(crack):
    """That the crack test can fail: the same points are wrong when subsets may reach across."""
    reference, deformed, region = crack
    field = Correlator(reference, np.ones_like(region), SMALL).correlate(deformed)
    x, y = np.meshgrid(field.x_px, field.y_px)
    truth = np.where(y < CRACK_Y, -opening(x), opening(x))
    lips = field.active & (np.abs(y - CRACK_Y) <= 8) & (x < TIP_X - 10)
    right = np.abs(field.v_px[lips] - truth[lips]) < 0.1
    assert right.mean() < 0.6


def test_a_hole_does_not_smear(speckle):
    pattern, other = speckle(seed=42), speckle(seed=43)
    y, x = np.mgrid[: pattern.shape[0], : pattern.shape[1]]
    hole = np.hypot(x - 90, y - 80) < 29
    moved = pattern.draw(lambda x, y: ((x - 1.7) / 1.01, y + 0.6))
    moved[np.hypot(x - 1.7 - 0.9 - 90, y + 0.6 - 80) < 29] = other.draw()[80, 90]
    field = Correlator(pattern.draw(), ~hole, SMALL).correlate(moved)
    px, py = np.meshgrid(field.x_px, field.y_px)
    around = field.active & (np.hypot(px - 90, py - 80) < 42)
    assert around.sum() > 80
    assert field.converged[around].all()
    np.testing.assert_allclose(field.u_px[around], 1.7 + 0.01 * px[around], atol=0.02)
    np.testing.assert_allclose(field.v_px[around], -0.6, atol=0.02)


def test_clipped_subsets_state_their_larger_noise(speckle):
    pattern = speckle(seed=44, shape=(200, 220))
    region = np.zeros(pattern.shape, bool)
    for left in range(10, 200, 26):
        region[10:190, left : left + 13] = True
    settings = CorrelationSettings(subset_px=21, step_px=4)
    sharp, moved = pattern.draw(), pattern.draw(lambda x, y: (x - 0.4, y - 0.3))
    rng = np.random.default_rng(5)
    noisy = [(image + rng.normal(0, 4, image.shape)).astype(np.float32) for image in (sharp, moved)]
    clipped = Correlator(noisy[0], region, settings).correlate(noisy[1])
    whole = Correlator(noisy[0], np.ones_like(region), settings).correlate(noisy[1])
    score = (clipped.u_px - 0.4)[clipped.converged] / clipped.std_u_px[clipped.converged]
    assert score.size > 500
    assert np.sqrt(np.mean(score**2)) == pytest.approx(1.0, abs=0.2)
    # Strips of 13 px leave at most 13/21 of a subset's pixels: the variance grows at least inversely.
    ratio = np.nanmedian(clipped.std_u_px) / np.nanmedian(whole.std_u_px)
    assert ratio > 0.95 * np.sqrt(21 / 13)


@pytest.mark.extended
def test_two_bodies_that_move_apart_are_both_found(speckle, turn):
    pattern = speckle(seed=45, shape=(200, 300))
    body = turn(35.0, (225.0, 100.0))

    def back(x, y):
        turned_x, turned_y = body(x, y)
        return np.where(x < 150, x - 0.3, turned_x), np.where(x < 150, y, turned_y)

    field = Correlator(pattern.draw(), settings=SMALL).correlate(pattern.draw(back))
    x, y = np.meshgrid(field.x_px.astype(float), field.y_px.astype(float))
    still = field.active & (x < 150 - 12)
    turned = field.active & (np.hypot(x - 225, y - 100) < 55)
    c, s = np.cos(np.radians(35.0)), np.sin(np.radians(35.0))
    truth = c * (x - 225) + s * (y - 100) - (x - 225)
    np.testing.assert_allclose(field.u_px[still], 0.3, atol=5e-3)
    assert field.converged[turned].all()
    np.testing.assert_allclose(field.u_px[turned], truth[turned], atol=0.02)


def test_a_look_alike_does_not_spoil_the_field(speckle):
    """A seed, as all points are with 30 px in between, appears a second time, and better."""
    pattern = speckle(seed=46, shape=(240, 260))
    correlator = Correlator(
        pattern.draw(), settings=CorrelationSettings(subset_px=21, step_px=30, shape="affine")
    )
    honest = pattern.draw(lambda x, y: (x - 12, y))
    noisy = honest + np.random.default_rng(1).normal(0, 6, honest.shape).astype(np.float32)
    grid = correlator.correlate(honest)
    column, row = len(grid.x_px) // 2, len(grid.y_px) // 2
    x, y = grid.x_px[column], grid.y_px[row]
    noisy[y - 16 : y + 17, x - 37 : x - 4] = pattern.draw()[y - 16 : y + 17, x - 16 : x + 17]
    field = correlator.correlate(noisy)
    assert field.start == "search"
    beneath = np.abs(grid.x_px + 12 - (x - 20)) < 30
    assert field.u_px[row, column] == pytest.approx(12, abs=0.1)
    np.testing.assert_allclose(field.u_px[:, ~beneath], 12.0, atol=0.1)
