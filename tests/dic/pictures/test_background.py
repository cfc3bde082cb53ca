"""Tests of the background of a map in mm: the image, rectified as if seen from the front."""

import numpy as np
import pytest

from dic.pictures.background import background_of
from dic.pictures.places import PointCells, mapped

SHAPE = (900, 3600)
TILTED = np.array([[0.01, 0.0004, 2.0], [0.0003, -0.01, 30.0], [2e-6, -1e-6, 1.0]])
"""Calibration from px to mm with about 100 px/mm; the Y axis points up."""


def drawn(image):
    """Return the drawn background, and the position of each of its pixels in the original image, px."""
    x, y = np.meshgrid(np.linspace(100, 3500, 12), np.linspace(100, 800, 10))
    places = PointCells(np.stack([x, y], axis=-1), TILTED, "mm")
    background = background_of(image, places)
    left, right, lower, upper = background.extent
    rows, columns = background.grey.shape
    across = left + (np.arange(columns) + 0.5) * (right - left) / columns
    up = upper - (np.arange(rows) + 0.5) * (upper - lower) / rows
    return background.grey, mapped(np.linalg.inv(TILTED), np.stack(np.meshgrid(across, up), axis=-1))


def test_noise_of_a_large_image_is_averaged():
    """A drawn pixel holds about 3 × 3 pixels; their mean has a third of the noise (σ/√n)."""
    grey, there = drawn(np.random.default_rng(5).normal(100.0, 30.0, SHAPE).astype(np.float32))
    width_px = np.linalg.norm(np.diff(there, axis=1), axis=-1).mean()
    height_px = np.linalg.norm(np.diff(there, axis=0), axis=-1).mean()
    assert 2.5 < np.sqrt(width_px * height_px) < 3.5
    known = np.isfinite(grey)
    assert known.mean() > 0.7
    assert grey[known].mean() == pytest.approx(100.0, abs=0.5)
    assert grey[known].std() < 1.1 * 30.0 / np.sqrt(width_px * height_px)


def test_every_place_has_the_grey_level_of_the_image():
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    grey, there = drawn((0.05 * x + 0.03 * y).astype(np.float32))
    expected = 0.05 * there[..., 0] + 0.03 * there[..., 1]
    known = np.isfinite(grey)
    # half a pixel of a drawn picture would be 0.07 grey levels
    np.testing.assert_allclose(grey[known], expected[known], atol=0.02)
