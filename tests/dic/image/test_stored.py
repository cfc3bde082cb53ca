"""Images that stay in memory as they are stored: their rows are those of the converted and smoothed image."""

import cv2
import numpy as np
import pytest

from dic.correlation.smoothing import gaussian_taps
from dic.image.spline import spline_image, spline_of_rows
from dic.image.stored import StoredImage

SHAPE = (700, 130)


def stored_image(kind, taps=(1.0,)):
    levels = np.random.default_rng(4).uniform(0, 255, SHAPE)
    return StoredImage(levels.astype(kind), taps)


@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize("width_px", [0.0, 0.7])
def test_rows_are_those_of_the_whole_smoothed_image(kind, width_px):
    image = stored_image(kind, gaussian_taps(width_px))
    taps = np.array(image.taps, np.float32)
    grey = image.stored.astype(np.float32)
    whole = cv2.sepFilter2D(grey, cv2.CV_32F, taps, taps, borderType=cv2.BORDER_REFLECT_101)
    for first, last in ((0, 5), (3, 300), (299, 301), (650, 700)):
        rows = image.rows(first, last)
        assert rows.dtype == np.float32
        np.testing.assert_array_equal(rows, whole[first:last])


@pytest.mark.parametrize("order", [3, 5])
@pytest.mark.parametrize("rows", [(0, 40), (1, 600), (2, 3), (255, 258), (300, 699), (690, 700)])
def test_a_band_has_the_coefficients_and_slopes_of_the_whole_image(order, rows):
    image = stored_image(np.uint8)
    whole = spline_image(image.rows(0, len(image.stored)), order)
    band = spline_of_rows(image, order, slice(*rows))
    np.testing.assert_array_equal(band.grey, whole.grey[slice(*rows)])
    np.testing.assert_array_equal(band.coefficients, whole.coefficients[rows[0] : rows[1] + 6])
    for own, of_whole in zip(band.gradient(), whole.gradient(), strict=True):
        np.testing.assert_array_equal(own, of_whole[slice(*rows)])


@pytest.mark.parametrize("kind", [np.uint8, np.float32])
def test_a_reduced_image_has_the_means_of_areas(kind):
    image = stored_image(kind)
    reduced = image.reduced((13, 70))
    exact = image.stored.astype(float).reshape(70, 10, 13, 10).mean(axis=(1, 3))
    np.testing.assert_allclose(reduced, exact, atol=1e-3)
    assert image.mean() == pytest.approx(exact.mean(), rel=1e-6)


def test_the_mean_does_not_depend_on_the_stored_type():
    levels = np.random.default_rng(5).integers(120, 250, (1400, 500), np.uint8)
    # The exact sum, as whole numbers, exceeds the 2^24 up to which float32 counts exactly.
    mean = int(levels.sum(dtype=np.int64)) / levels.size
    assert StoredImage(levels).mean() == StoredImage(levels.astype(np.float32)).mean() == mean


def test_a_turned_image_has_turned_rows():
    image = stored_image(np.uint8).turned(1)
    assert image.shape == SHAPE[::-1]
    np.testing.assert_array_equal(image.rows(5, 9), np.rot90(stored_image(np.uint8).stored)[5:9])
