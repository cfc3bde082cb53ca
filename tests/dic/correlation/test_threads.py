"""Fields do not depend on the number of threads."""

import numpy as np
import pytest

from dic.correlation import kernel
from dic.correlation.correlator import Correlator
from dic.correlation.settings import CorrelationSettings


@pytest.mark.parametrize(
    ("shape", "threads"),
    [
        ("quadratic", 5),
        *(
            pytest.param(*case, marks=pytest.mark.extended)
            for case in (("affine", 2), ("affine", 5), ("quadratic", 2))
        ),
    ],
)
def test_fields_are_the_same_for_any_number_of_threads(speckle, turn, threads, shape):
    """Of a pair and of a series, with points out of view, a part that is torn away, and no region."""
    pattern, other = speckle(seed=61, shape=(330, 300), noise=1.0), speckle(seed=62, shape=(330, 300))
    reference = pattern.draw(noise_seed=1)
    images = [pattern.draw(turn(angle, (150, 165)), noise_seed=k) for k, angle in enumerate((2.0, 3.5), 2)]
    images[1][200:260, 100:180] = other.draw()[200:260, 100:180]
    settings = CorrelationSettings(subset_px=21, step_px=8, shape=shape)

    def measured(threads):
        correlator = Correlator(reference, settings=settings, threads=threads)
        first = correlator.correlate(images[0])
        return first, correlator.correlate(images[1], previous=first)

    for expected, found in zip(measured(1), measured(threads), strict=True):
        assert expected.converged.any()
        assert (~expected.converged[expected.active]).any()
        for name in ("warps", "std", "zncc", "status", "iterations", "active"):
            np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))


def test_nearly_every_point_is_solved_in_a_band(speckle, monkeypatch):
    """Bands without a seed of their own are given one, or the threads would have little to share."""
    solved = {"whole grid": 0, "bands": 0}
    propagate = kernel.propagate

    def counting(image, deformed, method, grid, solution, pending, prepared):
        before = pending.sum()
        propagate(image, deformed, method, grid, solution, pending, prepared)
        solved["whole grid" if len(grid.y) == rows else "bands"] += int(before - pending.sum())

    monkeypatch.setattr(kernel, "propagate", counting)
    pattern = speckle(seed=63, shape=(420, 200))
    settings = CorrelationSettings(subset_px=21, step_px=4)
    correlator = Correlator(pattern.draw(), settings=settings, threads=1)
    rows = len(np.arange(14, 420 - 14, 4))
    field = correlator.correlate(pattern.draw(lambda x, y: (x - 3.3, y + 1.2)))
    assert len(field.y_px) == rows
    assert solved["bands"] > 0.95 * field.converged.sum()
