"""Crossing edges are found wherever exact arithmetic finds them, and touching edges do not count."""

from fractions import Fraction
from itertools import combinations

import numpy as np
import pytest

from dic.regions.crossings import find_crossings

SQUARE = np.array([[0, 0], [10, 0], [10, 10], [0, 10]], float)
RIGHT = np.array([10.0, 0.0])


def cross_exactly(a, b, c, d):
    def side(p, q, r):
        (px, py), (qx, qy), (rx, ry) = (map(Fraction, point) for point in (p, q, r))
        value = (qx - px) * (ry - py) - (qy - py) * (rx - px)
        return (value > 0) - (value < 0)

    return side(a, b, c) * side(a, b, d) < 0 and side(c, d, a) * side(c, d, b) < 0


@pytest.mark.parametrize("seed", range(6))
def test_crossings_are_those_of_exact_arithmetic(seed):
    rng = np.random.default_rng(seed)
    # Whole numbers, so that many edges touch, overlap or are vertical.
    polygons = [rng.integers(0, 9, (rng.integers(3, 7), 2)).astype(float) for _ in range(12)]
    ends = [np.roll(one, -1, axis=0) for one in polygons]
    edges = [(k, a, b) for k in range(12) for a, b in zip(polygons[k], ends[k], strict=True)]
    expected = {(i, j) for (i, a, b), (j, c, d) in combinations(edges, 2) if cross_exactly(a, b, c, d)}
    assert len(expected) > 10
    assert {(one.first, one.second) for one in find_crossings(polygons)} == expected


def test_the_place_of_a_crossing_is_named():
    (crossing,) = find_crossings([np.array([[0, 0], [10, 10], [10, 0], [0, 6]], float)])
    # The diagonal y = x meets the edge y = 6 - 0.6 x.
    assert (crossing.first, crossing.second) == (0, 0)
    assert (crossing.x, crossing.y) == pytest.approx((3.75, 3.75))


def test_neighbours_with_a_shared_edge_and_nested_polygons_do_not_cross():
    assert find_crossings([SQUARE, SQUARE + RIGHT, SQUARE * 0.5 + 2, SQUARE + RIGHT[::-1]]) == []
    assert find_crossings([]) == []
    assert [one[:2] for one in find_crossings([SQUARE, SQUARE + 3])] == [(0, 1)]
