"""A laid part of an image has the coefficients that it has in the whole image."""

import numpy as np
import pytest

from dic.correlation.kernel import Part, PartMemory, lay_deformed, lay_reference, part_of_reference
from dic.correlation.smoothing import Smoothing
from dic.image.spline import MARGIN, spline_image
from dic.image.stored import StoredImage

HEIGHT, WIDTH, MEAN = 90, 130, 100.0
PARTS = (Part(30, 60, 40, 90), Part(0, 25, 0, 30), Part(70, 90, 95, 130), Part(0, 90, 0, 130))


@pytest.fixture(scope="module")
def image():
    return np.random.default_rng(3).integers(0, 255, (HEIGHT, WIDTH)).astype(np.uint8)


@pytest.mark.parametrize("part", PARTS)
@pytest.mark.parametrize(("order", "width_px"), [(3, 0.0), (5, 0.0), (5, 0.6)])
def test_the_coefficients_are_those_of_the_whole_image(image, part, order, width_px):
    smoothing = Smoothing(width_px)
    whole = lay_deformed(StoredImage(smoothing.apply(image.astype(np.float32))), order, MEAN)
    memory = PartMemory(order, MEAN, smoothing.taps)
    # The memory is used again for parts of other sizes.
    memory.lay(image, Part(10, 80, 10, 120))
    laid = memory.lay(image, part)
    assert (laid.width, laid.height) == (part.right - part.left, part.bottom - part.top)
    y = np.arange(-MARGIN, laid.height + MARGIN)[:, None]
    x = np.arange(-MARGIN, laid.width + MARGIN)
    here = laid.c[laid.origin + y * laid.pitch + x]
    there = whole.c[whole.origin + (part.top + y) * whole.pitch + part.left + x]
    scale = np.abs(there).max()
    np.testing.assert_allclose(here, there, atol=(1e-5 if width_px else 0.0) * scale, rtol=0)


def test_a_part_of_the_reference_has_its_planes(image):
    whole = lay_reference(spline_image(image.astype(np.float32), 5), image > 20, MEAN)
    part = Part(12, 44, 7, 58)
    own = part_of_reference(whole, part)
    y, x = np.arange(32)[:, None], np.arange(51)
    for name in ("f", "fx", "fy", "inside"):
        here = getattr(own, name)[own.origin + y * own.pitch + x]
        there = getattr(whole, name)[whole.origin + (y + 12) * whole.pitch + x + 7]
        np.testing.assert_array_equal(here, there)


def test_a_part_outside_the_image_is_empty():
    assert Part(-50, -10, 5, 20).within((HEIGHT, WIDTH)) == Part(0, 0, 5, 20)
    assert Part(95, 120, 5, 20).within((HEIGHT, WIDTH)).pixels == 0
