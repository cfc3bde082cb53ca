"""Weighted sums over points, from the values of smooth functions at a few nodes."""

import numpy as np
import pytest

from dic.out_of_plane.nodes import Nodes

RNG = np.random.default_rng(7)
POINTS = RNG.uniform([-6.0, 2.0], [4.0, 9.0], (5000, 2))
WEIGHTS = RNG.normal(size=(5000, 2, 3))


def sums(values):
    """Return the weighted sums over all points, one component after the other."""
    return np.einsum("ncp,nc->p", WEIGHTS, values)


@pytest.mark.parametrize("slopes", [(0.0, 0.0), (0.002, -0.001), (0.02, 0.05)])
def test_a_projection_of_polynomials_has_the_sums_of_all_points(slopes):
    """The rays of a camera 40 mm away meet a sloped surface; its height is of third degree."""

    def seen(at):
        x, y = at.T
        reach = 1.0 / (1.0 + at @ slopes / 40.0)
        return np.stack([x * reach, (y + 0.01 * x * x * y) * reach], axis=1)

    nodes = Nodes.of(POINTS, WEIGHTS)
    found = np.einsum("kcp,kc->p", nodes.weights, seen(nodes.at))
    np.testing.assert_allclose(found, sums(seen(POINTS)), rtol=0, atol=1e-9 * np.abs(WEIGHTS).sum())
    mean = nodes.share @ seen(nodes.at)
    np.testing.assert_allclose(mean, seen(POINTS).mean(axis=0), rtol=0, atol=1e-9)


def test_points_on_a_line_have_sums_too():
    nodes = Nodes.of(POINTS * [1.0, 0.0], WEIGHTS)
    moved = np.einsum("kcp,kc->p", nodes.weights, nodes.at)
    np.testing.assert_allclose(moved, sums(POINTS * [1.0, 0.0]), rtol=1e-9)
