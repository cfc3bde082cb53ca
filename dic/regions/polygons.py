"""Computes masks of the pixels inside polygons, and of the pixels near a line."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from dic.typing import Float, Mask


def polygon_mask(polygons: Sequence[Float], shape: tuple[int, ...]) -> Mask:
    """Return a mask that is True at pixels whose centre lies inside an odd number of polygons.

    Therefore a polygon inside another polygon is a hole.

    `shape`: height and width of the image. Each of `polygons` has the shape (corners, 2).
    """
    height, width = shape
    starts = np.concatenate(polygons)
    ends = np.concatenate([np.roll(corners, -1, axis=0) for corners in polygons])
    pixels = np.arange(width)
    mask = np.zeros((height, width), np.bool_)
    for y in range(height):
        # A corner exactly on this row belongs only to the edge below the row, so that no corner counts twice.
        crossed = (starts[:, 1] <= y) != (ends[:, 1] <= y)
        (x0, y0), (x1, y1) = starts[crossed].T, ends[crossed].T
        crossings = np.sort(x0 + (y - y0) / (y1 - y0) * (x1 - x0))
        mask[y] = np.searchsorted(crossings, pixels, side="right") % 2 == 1
    return mask


def line_mask(path: Float, width_px: float, shape: tuple[int, ...]) -> Mask:
    """Return a mask that is True at pixels whose centre is at most half of a width away from a line.

    `path`, shape (places, 2): places that straight lines connect, (x, y) in px. `shape`: height and width of
    the image.
    """
    height, width = shape
    mask = np.zeros((height, width), np.bool_)
    reach = width_px / 2
    for start, end in pairwise(path):
        low = np.floor(np.minimum(start, end) - reach).astype(int)
        high = np.ceil(np.maximum(start, end) + reach).astype(int) + 1
        (left, top), (right, bottom) = np.maximum(low, 0), np.minimum(high, (width, height))
        if left >= right or top >= bottom:
            continue
        x, y = np.meshgrid(np.arange(left, right), np.arange(top, bottom))
        to = np.stack([x, y], axis=-1) - start
        along = end - start
        share = np.clip(to @ along / max(float(along @ along), 1e-30), 0.0, 1.0)
        away = to - share[..., None] * along
        mask[top:bottom, left:right] |= (away**2).sum(axis=-1) <= reach**2
    return mask
