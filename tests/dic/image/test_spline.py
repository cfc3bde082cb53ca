from fractions import Fraction
from math import comb, factorial

import numpy as np
import pytest
from scipy.ndimage import map_coordinates, spline_filter

from dic.image import spline
from dic.image.spline import MARGIN, spline_image


@pytest.fixture(scope="module")
def noise_image():
    return np.random.default_rng(3).uniform(0, 255, (90, 110)).astype(np.float32)


@pytest.mark.parametrize("order", [3, 5])
def test_coefficients_are_those_of_scipy(noise_image, order):
    ours = spline_image(noise_image, order).coefficients[MARGIN:-MARGIN, MARGIN:-MARGIN]
    theirs = spline_filter(noise_image.astype(float), order, mode="mirror")
    np.testing.assert_allclose(ours, theirs, atol=3e-3)


@pytest.mark.parametrize("order", [3, 5])
def test_gradient_is_the_slope_of_scipys_spline(noise_image, order):
    along_x, along_y = spline_image(noise_image, order).gradient()
    rows, columns = np.mgrid[10:80, 10:100].astype(float)
    h = 1e-3

    def grey(dy, dx):
        return map_coordinates(
            noise_image.astype(float), [rows + dy, columns + dx], order=order, mode="mirror"
        )

    np.testing.assert_allclose(along_x[10:80, 10:100], (grey(0, h) - grey(0, -h)) / (2 * h), atol=2e-3)
    np.testing.assert_allclose(along_y[10:80, 10:100], (grey(h, 0) - grey(-h, 0)) / (2 * h), atol=2e-3)


@pytest.mark.parametrize("order", [3, 5])
def test_constants_are_the_values_of_the_b_spline(order):
    """The B-spline is a sum of truncated powers; the last digit may be rounded otherwise."""

    def exact(place, power):
        steps = [place + Fraction(order + 1, 2) - k for k in range(order + 2)]
        terms = [(-1) ** k * comb(order + 1, k) * max(step, 0) ** power for k, step in enumerate(steps)]
        return float(sum(terms) / factorial(power))

    half = (order + 1) // 2
    pixels = [Fraction(k) for k in range(1 - half, half)]
    between = [Fraction(2 * k + 1, 2) for k in range(-half, half)]
    tolerance = {"rtol": 3e-16, "atol": 0}
    np.testing.assert_allclose(spline._AT_PIXELS[order], [exact(x, order) for x in pixels], **tolerance)
    np.testing.assert_allclose(spline._HALF_WAY[order], [exact(x, order) for x in between], **tolerance)
    np.testing.assert_allclose(spline._SLOPES[order], [-exact(x, order - 1) for x in pixels], **tolerance)


def test_a_spline_of_another_order_is_refused(noise_image):
    with pytest.raises(ValueError, match="spline order: expected 3 or 5, got 4"):
        spline_image(noise_image, 4)
