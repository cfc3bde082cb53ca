"""Detection of a square lattice of round dots, with or without three hollow dots as marks."""

from collections.abc import Callable
from functools import partial

import numpy as np

from dic.errors import CalibrationError
from dic.targets.arrangement import Arrangement
from dic.targets.axes import Axes, XAxis, axes_in_image
from dic.targets.dot_lattice import FEWEST_DOTS, dots_not_found, measure_dots, round_dots
from dic.targets.hollow_marks import HollowMarks, find_hollow_marks
from dic.targets.points import GridPoints
from dic.typing import Float, Grey, Indices

# Smallest share of the dots that must be found: of all dots, and, for a plate with marks, of the dots in the
# image.
_SUFFICIENT, _SUFFICIENT_WITH_MARKS = 0.9, 0.5
# Smallest share of the places in a lattice that must have dots. Speckles seldom fill a lattice.
_FILLED = 0.6


def find_dots(grey: Grey, dots: tuple[int, int], pitch_mm: float, source: str, x_axis: XAxis) -> GridPoints:
    """Return the centres of a lattice of dots. `dic.targets.DotTarget` describes this target.

    If three of the dots are hollow, they mark the origin and the axes, and the lattice may be larger than the
    picture. Dots that the image's rim cuts are left out.

    Raises `CalibrationError` if fewer than 90 % of the dots are found, or the numbers of rows and columns
    differ from `dots`. For a plate with marks: if fewer than half of the dots in the picture are found, or
    the dots do not fit into a lattice of this size.
    """
    refusal = _refusal(source, dots)
    found = measure_dots(grey, dots[0] * dots[1], source, refusal)
    marks = find_hollow_marks(found.index, found.hollow, found.vectors_px)
    index, centre = found.index[found.sound], found.centre_px[found.sound]
    if marks is not None:
        return _numbered_by_marks(index, centre, marks, dots, pitch_mm, source)
    axes, spans = _axes_and_spans(found.index, found.vectors_px, dots, x_axis, source)
    if len(index) < _SUFFICIENT * dots[0] * dots[1]:
        raise refusal(f"only {len(index)} whole dots{found.beside_a_reflection}")
    column_row = axes.columns_and_rows(index, spans)
    by_row = np.lexsort((column_row[:, 0], column_row[:, 1]))
    return GridPoints.on_lattice(
        column_row[by_row], centre[by_row], dots, pitch_mm, axes.warnings, axes.orientation
    )


def dots_seen(grey: Grey) -> Arrangement | None:
    """Return the arrangement of the dots that the image (height, width) shows, or None."""
    found = round_dots(grey)
    if found is None:
        return None
    index, hollow = found
    # The edge of the image may cut a plate with marks in any direction, so the outline does not show its
    # rows. The rows of such a plate are those of the lattice.
    seen = Arrangement.of(index, marked=bool(np.count_nonzero(hollow) == 3))
    return None if seen.filled < _FILLED or seen.in_turn else seen


def _axes_and_spans(
    index: Indices, vectors: Float, dots: tuple[int, int], x_axis: XAxis, source: str
) -> tuple[Axes, tuple[range, range]]:
    """Return the axes and the ranges of lattice indices of a plate without marks, all of it in view."""
    seen = Arrangement.of(index)
    if seen.asymmetric and seen.filled >= _SUFFICIENT and not seen.in_turn:
        raise _refusal(source, dots)(str(seen), remedy=f"give {seen.options}")
    if len(index) < _SUFFICIENT * dots[0] * dots[1]:
        raise _refusal(source, dots)(f"{len(index)} dots in a lattice, without three hollow dots as marks")
    counts = tuple(int(count) for count in np.ptp(index, axis=0) + 1)
    if sorted(counts) != sorted(dots):
        raise _refusal(source, dots)(f"{counts[0]} × {counts[1]} dots, without three hollow dots as marks")
    low = index.min(axis=0)
    spans = (range(int(low[0]), int(low[0]) + counts[0]), range(int(low[1]), int(low[1]) + counts[1]))

    def possible(axes: Axes) -> bool:
        return tuple(len(spans[axis]) for axis in axes.lattice_axes) == tuple(dots)

    return axes_in_image(vectors, x_axis, source, possible), spans


def _numbered_by_marks(
    index: Indices, centre: Float, marks: HollowMarks, dots: tuple[int, int], pitch_mm: float, source: str
) -> GridPoints:
    """Return the points of a plate with marks. The origin of X and Y is the origin mark."""
    signs = np.where(marks.axes.flip, -1, 1)
    from_mark = (index - marks.origin)[:, list(marks.axes.lattice_axes)] * signs
    low, high = from_mark.min(axis=0), from_mark.max(axis=0)
    seen = high - low + 1
    if (seen > dots).any():
        raise _refusal(source, dots)(f"{seen[0]} × {seen[1]} dots, with the marks of a plate")
    # On most plates the marks lie symmetrically about the middle, which gives the number of each column and
    # row. If the visible dots contradict this, take the nearest numbering that contains all dots. X and Y do
    # not depend on the numbering.
    symmetric = (np.array(dots) - 1 - np.array(marks.pitches)) // 2
    column_row = from_mark + np.clip(symmetric, -low, np.array(dots) - 1 - high)
    if len(index) < max(FEWEST_DOTS, _SUFFICIENT_WITH_MARKS * _of_hull(index)):
        raise _refusal(source, dots)(f"only {len(index)} whole dots between the outermost ones")
    by_row = np.lexsort((column_row[:, 0], column_row[:, 1]))
    xy_mm = from_mark[by_row].astype(np.float64) * pitch_mm
    return GridPoints(column_row[by_row], xy_mm, centre[by_row], dots, pitch_mm, (), "mark")


def _of_hull(index: Indices) -> float:
    """Return approximately how many dots a lattice without gaps has in the convex hull of the given dots."""
    from scipy.spatial import ConvexHull

    # Pick's theorem: the number of dots is the area + half of the dots on the rim + 1. The number of dots on
    # the rim is estimated as that of a rectangle.
    hull = ConvexHull(index)
    return float(hull.volume + hull.area / 2 + 1)


def _refusal(source: str, dots: tuple[int, int]) -> Callable[..., CalibrationError]:
    expected = (
        f"{dots[0]} × {dots[1]} dots, at least {_SUFFICIENT:.0%} of them, or a plate with three hollow dots"
    )
    return partial(dots_not_found, source, expected, "--dots gives their numbers")
