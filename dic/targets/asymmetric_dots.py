"""Detection of an asymmetric grid of dots: rows of dots, every second one shifted by half a pitch.

    row 3       ●   ●   ●   ●       4 × 4 dots: 4 dots in each row, 4 rows.
    row 2         ●   ●   ●   ●     Pitch: from one dot to the next in the same row.
    row 1       ●   ●   ●   ●       Rows are half a pitch apart.
    row 0         ●   ●   ●   ●

The top row begins at the left, as in OpenCV's pattern ``CALIB_CB_ASYMMETRIC_GRID``.
"""

from functools import partial

import numpy as np

from dic.targets.arrangement import Arrangement, half_pitch_vectors, half_pitches
from dic.targets.axes import Axes, XAxis, axes_in_image
from dic.targets.dot_lattice import dots_not_found, measure_dots
from dic.targets.points import GridPoints
from dic.typing import Grey, Indices

# Smallest share of the dots that must be found.
_SUFFICIENT = 0.9


def find_asymmetric_dots(
    grey: Grey, dots: tuple[int, int], pitch_mm: float, source: str, x_axis: XAxis
) -> GridPoints:
    """Return the centres of the dots of an asymmetric grid.

    `dic.targets.AsymmetricDotTarget` describes this target.

    Raises `CalibrationError` if fewer than 90 % of the dots are found, or the dots do not form an asymmetric
    grid.
    """
    expected = f"an asymmetric grid of {dots[0]} × {dots[1]} dots, at least {_SUFFICIENT:.0%} of them"
    counts = "--asymmetric-dots gives the numbers of dots in a row and of rows"
    refusal = partial(dots_not_found, source, expected, counts)
    found = measure_dots(grey, dots[0] * dots[1], source, refusal)
    seen = Arrangement.of(found.index)
    if not seen.asymmetric or sorted(seen.box) != sorted((2 * dots[0], dots[1])):
        if seen.filled < _SUFFICIENT:
            raise refusal(f"{len(found.index)} dots in a lattice")
        raise refusal(str(seen), remedy="" if seen.in_turn else f"give {seen.options}")
    if np.count_nonzero(found.sound) < _SUFFICIENT * dots[0] * dots[1]:
        raise refusal(f"only {np.count_nonzero(found.sound)} whole dots{found.beside_a_reflection}")
    steps = half_pitches(found.index)
    low = steps.min(axis=0)
    spans = (range(int(low[0]), int(low[0]) + seen.box[0]), range(int(low[1]), int(low[1]) + seen.box[1]))
    axes = _axes(steps, spans, half_pitch_vectors(found.vectors_px), dots, x_axis, source)
    steps = axes.columns_and_rows(steps, spans)[found.sound]
    by_row = np.lexsort((steps[:, 0], steps[:, 1]))
    xy_mm = (steps - (np.array([2 * dots[0], dots[1]]) - 1) / 2)[by_row] * (pitch_mm / 2)
    return GridPoints(
        np.stack([steps[:, 0] // 2, steps[:, 1]], axis=-1)[by_row],
        xy_mm,
        found.centre_px[found.sound][by_row],
        dots,
        pitch_mm,
        axes.warnings,
        axes.orientation,
    )


def _axes(
    steps: Indices,
    spans: tuple[range, range],
    vectors_px: np.ndarray,
    dots: tuple[int, int],
    x_axis: XAxis,
    source: str,
) -> Axes:
    """Return the axes of a grid with dots at `steps` (n, 2), in half pitches; X is along the rows.

    With an odd number of rows, the top and the bottom row begin at the left, so the plate looks different
    after half a turn, and the dots determine the axes. With an even number of rows, the plate looks the same
    after half a turn. Then `x_axis` determines the axes, or X is the direction closest to the image's right.
    """

    def possible(axes: Axes) -> bool:
        if tuple(len(spans[axis]) for axis in axes.lattice_axes) != (2 * dots[0], dots[1]):
            return False
        begins_left = int(axes.columns_and_rows(steps[:1], spans).sum()) % 2 == 0
        return dots[1] % 2 == 0 or begins_left

    return axes_in_image(vectors_px, x_axis, source, possible)
