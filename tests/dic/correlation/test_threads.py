"""Work cut into bands: the cut depends on the work alone, and so does the result."""

import numpy as np
import pytest

from dic.correlation import kernel
from dic.correlation.correlator import Correlator
from dic.correlation.settings import CorrelationSettings
from dic.image.threads import at_once, bands_of, beside, even_bands


@pytest.mark.parametrize("rows", [1, 63, 64, 65, 200])
def test_bands_cover_every_row_once(rows):
    covered = np.concatenate([np.arange(rows)[band] for band in bands_of(rows, 64)])
    np.testing.assert_array_equal(covered, np.arange(rows))


def test_even_bands_share_out_the_work_and_leave_no_row_with_work_out():
    weights = np.random.default_rng(3).integers(0, 50, 300)
    weights[100:180] = 0
    bands = even_bands(weights, 16)
    shares = [weights[band].sum() for band in bands]
    assert sum(shares) == weights.sum()
    assert len(bands) == 16
    assert max(shares) < weights.sum() / 16 + 2 * weights.max()


def test_no_work_needs_no_band():
    assert even_bands(np.zeros(20, np.int64), 4) == []
    assert even_bands(np.zeros(0, np.int64), 4) == []


def test_what_is_beside_is_up_down_left_or_right():
    mask = np.zeros((4, 5), bool)
    mask[1, 2] = True
    found = {tuple(map(int, place)) for place in np.argwhere(beside(mask))}
    assert found == {(0, 2), (2, 2), (1, 1), (1, 3)}


def test_an_error_in_a_thread_is_seen():
    def fail(band):
        raise ValueError(band.start)

    with pytest.raises(ValueError, match="0"):
        at_once(fail, bands_of(200, 64), 3)


@pytest.mark.parametrize("threads", [2, 5])
@pytest.mark.parametrize("shape", ["affine", "quadratic"])
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
    correlate_grid = kernel.correlate_grid

    def counting(*arguments):
        status, _, _, pending, spread = arguments[11:16]
        before = pending.sum()
        correlate_grid(*arguments)
        if spread:
            solved["whole grid" if len(status) == rows else "bands"] += int(before - pending.sum())

    monkeypatch.setattr(kernel, "correlate_grid", counting)
    pattern = speckle(seed=63, shape=(420, 200))
    settings = CorrelationSettings(subset_px=21, step_px=4)
    correlator = Correlator(pattern.draw(), settings=settings, threads=1)
    rows = len(np.arange(14, 420 - 14, 4))
    field = correlator.correlate(pattern.draw(lambda x, y: (x - 3.3, y + 1.2)))
    assert len(field.y_px) == rows
    assert solved["bands"] > 0.95 * field.converged.sum()
