"""The mean gradient of many points, computed in blocks, is that of all points together."""

from dataclasses import replace

import numpy as np
import pytest

from dic.strain.displacement import Displacement, Noise
from dic.strain.fit import gradient_weights, mean_gradient
from dic.strain.mean_in_blocks import mean_gradient_in_blocks

ROWS, COLUMNS = 23, 17


def displaced(seed: int) -> Displacement:
    """Return displacements of a strained grid with gaps, in axes that are not those of the grid."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:ROWS, :COLUMNS] * 10.0
    position = np.stack([0.9 * x + 0.2 * y + 400.0, 0.1 * x - 1.1 * y], axis=-1)
    vector = position @ rng.normal(0, 0.01, (2, 2)) + rng.normal(0, 0.02, position.shape) + 3.0
    overlap = np.outer([1.0, 0.5, 0.1], [1.0, 0.4, 0.2])
    factors, bias = rng.normal(0, 0.01, (2, ROWS, COLUMNS, 2, 2))
    noise = Noise(factors, overlap, np.full((ROWS, COLUMNS, 4, 4), np.nan), bias)
    valid = rng.random((ROWS, COLUMNS)) < 0.8
    vector[~valid] = factors[~valid] = bias[~valid] = np.nan
    return Displacement(position, vector, valid, "px", None, noise)


@pytest.fixture(params=[1, 3, 10, 100])
def rows_at_a_time(request, monkeypatch):
    monkeypatch.setattr("dic.strain.mean_in_blocks._BLOCK_POINTS", request.param * COLUMNS)


def test_the_covariance_is_that_of_all_pairs_of_points(monkeypatch):
    """A Fourier transform sums errors that reach far, and a direct sum those that do not."""
    displacement = displaced(5)
    use, noise = displacement.valid, displacement.noise
    weights = np.zeros((*use.shape, 2, 4))
    weights[use] = gradient_weights(displacement.position[use])
    parts = np.einsum("rcia,rcip->rcpa", np.nan_to_num(noise.factors), weights).reshape(-1, 4, 2)
    row, column = (np.abs(each.ravel()[:, None] - each.ravel()) for each in np.indices(use.shape))
    shared = np.pad(noise.overlap, [(0, n) for n in use.shape])[row, column]
    expected = np.einsum("npa,nm,mqa->pq", parts, shared, parts, optimize=True)
    unbiased = replace(displacement, noise=replace(noise, bias=None))
    for near in (12, 0):
        monkeypatch.setattr("dic.strain.fit._NEAR", near)
        found = mean_gradient(unbiased, use).covariance
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


@pytest.mark.usefixtures("rows_at_a_time")
def test_blocks_give_the_gradient_and_the_covariance_of_all_points_together():
    displacement = displaced(4)
    whole, parts = (fit(displacement, displacement.valid) for fit in (mean_gradient, mean_gradient_in_blocks))
    np.testing.assert_allclose(parts.gradient, whole.gradient, rtol=1e-9)
    for mine, other in ((parts.covariance, whole.covariance), (parts.by_bias, whole.by_bias)):
        np.testing.assert_allclose(mine, other, rtol=1e-9, atol=1e-9 * np.abs(other).max())
    without = replace(displacement, noise=None)
    assert mean_gradient_in_blocks(without, displacement.valid).covariance is None


def test_points_on_a_line_have_no_mean_gradient():
    displacement = displaced(5)
    line = np.zeros((ROWS, COLUMNS), bool)
    line[4, 2:15] = True
    assert mean_gradient_in_blocks(displacement, line) is None
    line[5, 3] = True
    displacement.vector[line] = 0.0
    assert mean_gradient_in_blocks(displacement, line) is not None
    assert mean_gradient_in_blocks(displacement, line & (np.cumsum(line).reshape(line.shape) < 3)) is None
