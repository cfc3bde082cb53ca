"""Which points of a long series are drawn: those that are seen, where thousands would lie on each other."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from dic.typing import Float, Indices

MOST_DRAWN = 1500
"""All points of a line with at most this number of points are drawn."""
_PARTS = 300
"""A longer line is divided into this number of parts. Of each part its first point, the extremes and a gap
are drawn, so the line looks as if all points were drawn: a part is narrower than a point of print.
"""
_MOST_MARKERS = 100
"""A line with more points has markers at about this number of them."""


def thinned(*values: Float) -> Indices:
    """Return the indices of the points of a line that are drawn, in order.

    `values`: coordinates of the n points, and further values such as standard deviations, each of shape (n,).
    """
    count = len(values[0])
    if count <= MOST_DRAWN:
        return np.arange(count)
    edges = np.linspace(0, count, _PARTS + 1).astype(np.int64)
    kept = {count - 1}
    for first, stop in pairwise(edges.tolist()):
        kept.add(first)
        for each in values:
            part = each[first:stop]
            unknown = np.isnan(part)
            if unknown.any():
                kept.add(first + int(np.argmax(unknown)))
            if not unknown.all():
                kept |= {first + int(np.nanargmin(part)), first + int(np.nanargmax(part))}
    return np.array(sorted(kept))


def thin_lines(figure: Any) -> None:
    """Leave out the points of a figure's lines that nobody sees, and most of the markers of long lines."""
    for line in (line for axis in figure.axes for line in axis.lines):
        x, y = (np.asarray(each, np.float64) for each in line.get_data(orig=False))
        if len(x) > MOST_DRAWN:
            drawn = thinned(x, y)
            line.set_data(x[drawn], y[drawn])
        joined = line.get_linestyle() not in ("None", "none", "", " ")
        if joined and len(x) > _MOST_MARKERS:
            line.set_markevery(max(1, len(line.get_xdata()) // (_MOST_MARKERS // 4)))


def some_of(count: int, most: int, wanted: Sequence[int] = ()) -> list[int]:
    """Return at most `most` indices below `count`: first, last, those that are wanted, evenly spaced others.

    `most` is at least 2. All indices are returned if there are no more than `most`.
    """
    if count <= most:
        return list(range(count))
    chosen = list(dict.fromkeys([0, count - 1, *wanted]))[:most]
    for k in np.linspace(0, count - 1, most).round().astype(int).tolist():
        if len(chosen) < most and k not in chosen:
            chosen.append(k)
    return sorted(chosen)
