"""Kept data of a reference do not change the results, and need no more memory than the stated limit."""

import numpy as np
import pytest

from dic.correlation.correlator import Correlator
from dic.correlation.prepared_reference import SubsetMemory
from dic.correlation.settings import CorrelationSettings
from dic.image.point_grid import PointGrid


def bent(x, y):
    """A small deformation whose strain varies within a subset, as a function `back` for `SpecklePattern`."""
    return x - 1.4 - 0.01 * x - 1e-4 * (y - 80) ** 2, y + 0.8 + 0.012 * x


@pytest.mark.parametrize("shape", ["affine", "quadratic"])
def test_what_is_kept_for_a_series_does_not_change_results(speckle, shape):
    pattern = speckle(seed=39, shape=(150, 240), noise=1.0)
    region = np.ones(pattern.shape, bool)
    region[40:70, 100:115] = False
    reference = pattern.draw(noise_seed=1)
    images = [pattern.draw(lambda x, y, k=k: bent(x + k / 4, y), noise_seed=2 + k) for k in range(3)]
    settings = CorrelationSettings(21, 6, shape=shape)
    series = Correlator(reference, region, settings)
    for image in images:
        kept = series.correlate(image)
        alone = Correlator(reference, region, settings).correlate(image)
        assert kept.converged.any()
        for name in ("warps", "std", "zncc", "status", "iterations"):
            np.testing.assert_array_equal(getattr(kept, name), getattr(alone, name), err_msg=name)
    assert series._reference.memory.kept_bytes > 0


@pytest.mark.parametrize("shape", ["affine", "quadratic"])
@pytest.mark.parametrize("step_px", [1, 5, 20])
def test_a_series_keeps_nothing_of_a_pair_and_no_more_than_four_and_a_quarter_images(shape, step_px):
    side = 1000
    at = np.arange(20, side - 20, step_px)
    everywhere = np.ones((len(at), len(at)), bool)
    usable = np.ones((side, side), bool)
    grid = PointGrid(at, at, everywhere, everywhere.astype(np.int64), ~everywhere, usable)
    memory, parameters = SubsetMemory(), CorrelationSettings(shape=shape).parameters
    sizes = []
    for _ in range(4):
        memory.for_next_image(grid, parameters)
        sizes.append(memory.kept_bytes)
    assert sizes[0] == 0
    assert sizes[1] == sizes[2] == sizes[3] <= 4.25 * 4 * side * side + everywhere.size
    assert (sizes[1] > 0) == (step_px >= 5)


def test_no_data_of_a_large_image_are_kept():
    """They would take more memory than four images with 8 bit."""
    shape = (3000, 4100)
    at = np.arange(20, 2980, 10)
    everywhere = np.ones((len(at), len(at)), bool)
    grid = PointGrid(
        at, at, everywhere, everywhere.astype(np.int64), ~everywhere, np.broadcast_to(np.True_, shape)
    )
    memory = SubsetMemory()
    assert all(memory.for_next_image(grid, CorrelationSettings().parameters) is None for _ in range(3))
