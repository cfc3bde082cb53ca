"""The transforms are those of `scipy.fft` to the last bit, with and without its package."""

import numpy as np
import pytest
from scipy import fft

from dic.image import fourier


@pytest.mark.parametrize("loaded", [True, False], ids=["compiled part", "package"])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_transforms_are_those_of_scipy(monkeypatch, loaded, dtype):
    assert fourier._compiled() is not None
    if not loaded:
        monkeypatch.setattr(fourier, "_compiled", lambda: None)
    values = np.random.default_rng(4).normal(size=(30, 33, 2)).astype(dtype)
    size = fourier.next_fast_len(61), fourier.next_fast_len(34)
    assert size == (64, 36)
    waves = fourier.rfft2(values, size)
    pairs = [
        (fourier.fft2(values), fft.fft2(values)),
        (waves, fft.rfft2(values, size, axes=(0, 1))),
        (fourier.irfft2(waves, size), fft.irfft2(waves, size, axes=(0, 1))),
        (fourier.irfft2(np.abs(waves), size), fft.irfft2(np.abs(waves), size, axes=(0, 1))),
    ]
    for ours, theirs in pairs:
        assert ours.dtype == theirs.dtype
        np.testing.assert_array_equal(ours, theirs)
