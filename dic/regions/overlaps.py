"""Find polygons that cover each other in part although none of their edges cross."""

from collections.abc import Sequence

import numpy as np

from dic.regions.polygons import polygon_mask
from dic.typing import Float, Mask


def find_overlaps(polygons: Sequence[Float]) -> list[tuple[int, int]]:
    """Return the pairs of polygons that share pixels, but of which neither is a part of the other.

    Polygons whose edges lie on the same lines can overlap without a crossing of two edges, for example two
    rectangles of the same height. Two equal polygons are such a pair, too. A polygon inside another polygon
    and two polygons that only touch are no such pairs.

    `polygons`, each of shape (corners, 2): corners (x, y), px.
    """
    if not polygons:
        return []
    lows = np.array([np.ceil(corners.min(axis=0)) for corners in polygons])
    highs = np.array([np.floor(corners.max(axis=0)) + 1 for corners in polygons])
    found = []
    for first in range(len(polygons)):
        low, high = np.maximum(lows[first], lows), np.minimum(highs[first], highs)
        near = np.flatnonzero((low < high).all(axis=1))
        for second in near[near > first]:
            both = first, int(second)
            masks = [_part(polygons[k], low[second], high[second]) for k in both]
            # A polygon is inside the other one if no pixel of its own box is outside the other one.
            inside = [
                (lows[k] >= low[second]).all()
                and (highs[k] <= high[second]).all()
                and not (mine & ~others).any()
                for k, mine, others in zip(both, masks, masks[::-1], strict=True)
            ]
            if (masks[0] & masks[1]).any() and inside[0] == inside[1]:
                found.append(both)
    return found


def _part(corners: Float, low: Float, high: Float) -> Mask:
    """Return the pixels of a polygon between the pixel `low` and before the pixel `high`, both (x, y)."""
    width, height = (high - low).astype(int)
    return polygon_mask([corners - low], (height, width))
