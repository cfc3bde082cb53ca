"""The coefficients that the kernel reads are those of SciPy's spline, of a whole image and of its rows."""

import numpy as np
import pytest
from scipy.ndimage import spline_filter

from dic.correlation import kernel
from dic.image.spline import MARGIN
from dic.image.stored import StoredImage

IMAGE = np.random.default_rng(3).uniform(0, 255, (300, 110)).astype(np.float32)


def coefficients_of(laid, rows, columns):
    """The coefficients at pixels of the image, which may lie beyond its edges."""
    return laid.c[laid.origin + rows[:, None] * laid.pitch + columns]


@pytest.mark.parametrize(("order", "denominator"), [(3, 6), (5, 120)])
def test_coefficients_are_those_of_scipy_in_a_mirrored_image(order, denominator):
    mean = 127.0
    rows, columns = (np.arange(-MARGIN, length + MARGIN) for length in IMAGE.shape)
    theirs = spline_filter(IMAGE.astype(float), order, mode="mirror") - mean
    theirs = np.pad(theirs, MARGIN, mode="reflect") / denominator**2
    whole = kernel.lay_deformed(StoredImage(IMAGE), order, mean, threads=2)
    ours = coefficients_of(whole, rows, columns)
    np.testing.assert_allclose(ours, theirs, atol=3e-3 / denominator**2)
    for first, last in ((0, 40), (1, 299), (17, 19), (200, 300)):
        part = kernel.lay_deformed(StoredImage(IMAGE), order, mean, rows=slice(first, last))
        own = np.arange(first - MARGIN, last + MARGIN)
        np.testing.assert_array_equal(coefficients_of(part, own, columns), ours[own + MARGIN])
