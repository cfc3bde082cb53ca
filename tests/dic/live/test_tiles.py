"""Points of gauges are divided into tiles so that few pixels are interpolated."""

import numpy as np
import pytest

from dic.live.tiles import tiles_of


def block(x, y, count=5, step=10):
    at = np.stack(np.meshgrid(np.arange(count) * step, np.arange(count) * step), axis=-1).reshape(-1, 2)
    return at + np.array([x, y])


def test_two_patches_far_apart_are_two_tiles_and_one_block_is_one():
    points = np.concatenate([block(100, 100), block(100, 900)])
    tiles = tiles_of(points, 40)
    assert [len(own) for own in tiles] == [25, 25]
    assert np.ptp(points[tiles[0]], axis=0).max() == 40
    assert len(tiles_of(block(300, 300), 40)) == 1
    assert tiles_of(np.zeros((0, 2), np.int64), 40) == []


@pytest.mark.parametrize("around_px", [20, 60])
def test_a_diagonal_line_costs_less_in_tiles_and_loses_no_point(around_px):
    points = np.repeat(np.arange(0, 2000, 10)[:, None], 2, axis=1)
    tiles = tiles_of(points, around_px)
    assert sorted(np.concatenate(tiles).tolist()) == list(range(200))
    pixels = sum(np.prod(np.ptp(points[own], axis=0) + 2 * around_px) for own in tiles)
    assert pixels < 0.3 * (1990 + 2 * around_px) ** 2
    # A tile has a cost of its own.
    assert len(tiles) < 40
