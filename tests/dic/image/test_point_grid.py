"""Tests of `clear_of_edges`, which returns the pixels of a region that its edges do not disturb."""

import numpy as np
import pytest

from dic.image.point_grid import clear_of_edges, place_points
from dic.image.spline import edge_reach_px, spline_image


@pytest.mark.parametrize(("order", "reach_px"), [(3, 4), (5, 5)])
def test_the_spline_oscillates_as_far_from_a_step_as_is_said(order, reach_px):
    """Halfway between two pixels, a step of 1 leaves less than a thousandth beyond the reach."""
    assert edge_reach_px(order) == reach_px
    step = np.zeros((64, 64), np.float32)
    step[:, 32:] = 1.0
    # the derivative at a pixel is of the size of the oscillation between the pixels
    along_x, _ = spline_image(step, order).gradient()
    oscillation = np.abs(along_x[32, :32][::-1])
    assert oscillation[reach_px:].max() < 0.02 * oscillation[0]
    assert oscillation[reach_px - 2] > 0.02 * oscillation[0]


def test_a_wide_part_ends_before_its_edge_and_corner():
    region = np.zeros((80, 90), bool)
    region[10:70, 20:90] = True
    clear = clear_of_edges(region, 21, 5)
    expected = np.zeros_like(region)
    # the right edge of the region is that of the image, beside which nothing else is seen
    expected[15:65, 25:90] = True
    np.testing.assert_array_equal(clear, expected)


def test_both_sides_of_a_crack_end_before_it():
    region = np.ones((80, 90), bool)
    region[40] = False
    clear = clear_of_edges(region, 21, 5)
    assert not clear[35:46].any()
    assert clear[:35].all()
    assert clear[46:].all()


def test_what_is_too_narrow_is_used_whole_and_what_is_wide_beside_it_is_not():
    region = np.zeros((120, 100), bool)
    region[10:60, 10:90] = True
    region[60:110, 40:53] = True
    clear = clear_of_edges(region, 21, 5)
    np.testing.assert_array_equal(clear[70:110], region[70:110])
    assert not clear[10:15].any()
    assert not clear[10:54, 10:15].any()
    assert clear[15:55, 15:85].all()


def test_a_region_without_edges_is_used_whole():
    assert clear_of_edges(np.ones((40, 50), bool), 21, 5).all()


def test_bands_of_rows_change_neither_clear_pixels_nor_their_numbers(monkeypatch):
    rng = np.random.default_rng(5)
    region = np.ones((520, 200), bool)
    for _ in range(12):
        y, x, height, width = rng.integers((0, 0, 2, 2), (500, 180, 60, 60))
        region[y : y + height, x : x + width] = False
    found = []
    for band_px, rows in ((2048, 1000), (64, 3)):
        monkeypatch.setattr("dic.image.point_grid._BAND_PX", band_px)
        monkeypatch.setattr("dic.image.point_grid._ROWS", rows)
        usable = clear_of_edges(region, 21, 5)
        found.append((usable, place_points(region, usable, 21, 7)))
    (usable, grid), (banded, banded_grid) = found
    assert 0.2 < usable.mean() < 0.9
    np.testing.assert_array_equal(banded, usable)
    for name in ("active", "pixels", "cut"):
        np.testing.assert_array_equal(getattr(banded_grid, name), getattr(grid, name))
