"""Find places where edges of polygons cross each other."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from dic.typing import Float, Indices


class EdgeCrossing(NamedTuple):
    """Two edges that cross each other."""

    first: int
    second: int
    """The polygons of the two edges, counted from 0; equal if a polygon crosses itself."""
    x: float
    y: float
    """The place where the edges cross."""


def find_crossings(polygons: Sequence[Float]) -> list[EdgeCrossing]:
    """Return one crossing for each pair of polygons that cross, and one for each polygon that crosses itself.

    Edges that only touch, such as shared edges and corners of neighbours, do not cross.

    Each of `polygons` has the shape (corners, 2).
    """
    if not polygons:
        return []
    starts = np.concatenate(polygons)
    ends = np.concatenate([np.roll(corners, -1, axis=0) for corners in polygons])
    owners = np.repeat(np.arange(len(polygons)), [len(corners) for corners in polygons])
    # Edges in the order of their left ends: an edge can only cross edges that begin left of its right end.
    order = np.argsort(np.minimum(starts[:, 0], ends[:, 0]), kind="stable")
    starts, ends, owners = starts[order], ends[order], owners[order]
    left = np.minimum(starts[:, 0], ends[:, 0])
    last = np.searchsorted(left, np.maximum(starts[:, 0], ends[:, 0]), side="right")
    found: dict[tuple[int, int], EdgeCrossing] = {}
    for edge in range(len(starts)):
        others = np.arange(edge + 1, last[edge])
        for other in others[_cross(starts[edge], ends[edge], starts[others], ends[others])]:
            first, second = sorted((int(owners[edge]), int(owners[other])))
            x, y = _meeting(starts[edge], ends[edge], starts[other], ends[other])
            found.setdefault((first, second), EdgeCrossing(first, second, x, y))
    return [found[pair] for pair in sorted(found)]


def _cross(start: Float, end: Float, starts: Float, ends: Float) -> Indices:
    """Return the indices of the edges that cross the given edge, except at an end of one of the two edges."""
    sides = _side(start, end, starts) * _side(start, end, ends)
    own = _side(starts, ends, start) * _side(starts, ends, end)
    return np.flatnonzero((sides < 0) & (own < 0))


def _side(start: Float, end: Float, point: Float) -> Float:
    """Return the sign of the side of a directed edge on which a point lies: 1, -1, or 0 for on its line."""
    along, to = end - start, point - start
    return np.asarray(np.sign(along[..., 0] * to[..., 1] - along[..., 1] * to[..., 0]))


def _meeting(start: Float, end: Float, other_start: Float, other_end: Float) -> tuple[float, float]:
    along, across = end - start, other_end - other_start
    to = other_start - start
    share = (to[0] * across[1] - to[1] * across[0]) / (along[0] * across[1] - along[1] * across[0])
    x, y = start + share * along
    return float(x), float(y)
