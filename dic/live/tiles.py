"""Divides the points of gauges into tiles: rectangles of points whose pixels are interpolated together."""

import numpy as np

from dic.typing import Indices

_TILE_PX = 15_000
"""The fixed cost of a tile, in pixels that are interpolated in the same time."""

_GAIN = 0.95
"""A tile is divided if the parts cost less than this share of the whole."""


def tiles_of(points: Indices, around_px: int, fixed_px: int = _TILE_PX) -> list[Indices]:
    """Return the numbers of the points of each tile.

    `points`, shape (n, 2): coordinates (x, y) of the points, px. `around_px`: number of pixels around a point
    that are interpolated for it. `fixed_px`: number of pixels whose interpolation takes as long as what each
    tile needs in addition.

    Points that lie apart, such as the two patches of an extensometer, are in different tiles, so that the
    pixels between them are not interpolated.
    """
    found, left = [], [np.arange(len(points))] if len(points) else []
    while left:
        own = left.pop()
        parts = _divided(points, own, around_px, fixed_px)
        if parts is None:
            found.append(own)
        else:
            left += parts
    return sorted(found, key=lambda own: int(own[0]))


def _divided(points: Indices, own: Indices, around_px: int, fixed_px: int) -> list[Indices] | None:
    """Return the two parts of a tile that together cost least; None if the whole costs less."""
    least, best = _GAIN * _cost(points[own], around_px, fixed_px), None
    for axis in (0, 1):
        along = points[own, axis]
        for edge in np.unique(along)[1:]:
            parts = [own[along < edge], own[along >= edge]]
            cost = sum(_cost(points[part], around_px, fixed_px) for part in parts)
            if cost < least:
                least, best = cost, parts
    return best


def _cost(points: Indices, around_px: int, fixed_px: int) -> float:
    width, height = np.ptp(points, axis=0) + 2 * around_px + 1
    return float(width * height) + fixed_px
