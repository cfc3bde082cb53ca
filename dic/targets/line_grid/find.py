"""Automatic detection of a line grid in an image.

The detection has these steps:

1. Find the cells between the lines and arrange them on a lattice (`dic.targets.cells`).
2. Fit a smooth map from the lattice index to the position in the image (`dic.targets.lattice`).
3. Find out which lines are in the image (`dic.targets.line_grid.extent`).
4. Measure the centres of the lines (`dic.targets.line_grid.trace`).
5. Compute the intersections of the lines (`dic.targets.line_grid.crossings`).
6. Choose the directions of X and Y (`dic.targets.line_grid.mark`, `dic.targets.axes`).
"""

import numpy as np

from dic.errors import CalibrationError
from dic.targets.axes import Axes, XAxis, axes_in_image
from dic.targets.cells import find_cells
from dic.targets.lattice import LatticeShape, fits_lattice
from dic.targets.line_grid.cell_shape import cells_are_round
from dic.targets.line_grid.crossings import intersect
from dic.targets.line_grid.extent import line_extents
from dic.targets.line_grid.mark import find_mark, grid_spans, within
from dic.targets.line_grid.trace import trace_lines
from dic.targets.not_seen import TargetNotSeen
from dic.targets.points import GridPoints
from dic.targets.sampled_image import GridImage
from dic.typing import Float, Grey, Mask

__all__ = ["GridPoints", "find_grid"]

FEWEST_LINES, _FEWEST_CELLS = 4, 9
_SUFFICIENT = 0.9
# Smallest share of the cells that must be found to name a grid of unknown size. Speckles seldom reach this
# share.
_FILLED = 0.6
_ORIGIN_REMEDY = "give with --origin-px where the grid's middle intersection is in the image, or leave it out"
_REMEDY = (
    "check that the whole grid is in view, sharp and evenly lit, and that --lines gives its numbers of lines"
)


def find_grid(
    image: Grey,
    lines: tuple[int, int] = (21, 21),
    pitch_mm: float = 0.5,
    source: str = "grid image",
    *,
    x_axis: XAxis = None,
    origin_px: tuple[float, float] | None = None,
) -> GridPoints:
    """Find the intersections of a line grid, seen from any direction, to a few thousandths of a pixel.

    Parameters
    ----------
    image : ndarray, shape (height, width)
        Grey levels of the image. The lines may be darker or brighter than the background.
    lines : tuple of int
        Numbers of lines along X and along Y, at least 4 each.
    pitch_mm : float
        Distance between neighbouring lines.
    source : str
        Name of the image file, used in error messages.
    x_axis : str or float, optional
        Wanted direction of X in the image: ``"right"``, ``"up"``, ``"left"``, ``"down"``, or an angle in
        degrees, anticlockwise from the right. X becomes the grid direction closest to this direction.
    origin_px : tuple of float, optional
        Position of the intersection ``(lines // 2, lines // 2)`` in the image, with an error of at most 0.4
        pitches. For odd numbers of lines, this intersection is the middle one. The position is needed only if
        an outer line is hidden completely and the grid has no mark.

    Returns
    -------
    GridPoints
        The intersections that were found: at least 90 % of all intersections. The direction of X comes from a
        mark on the grid (`dic.targets.line_grid.mark`) or from `x_axis`. If there is no mark and no `x_axis`,
        X is the grid direction closest to the image's right, Y is the grid direction closest to the image's
        top, and `orientation` is ``"assumed"``. If the grid is turned by about 45° in the image, this choice
        is ambiguous, and `warnings` contains a sentence about this.

    Raises
    ------
    CalibrationError
        If the image shows no line grid, a different number of lines, or fewer than 90 % of the intersections;
        if the mark and the options contradict each other; if `x_axis` is halfway between two directions of
        the grid.
    """
    lines = (int(lines[0]), int(lines[1]))
    _require_possible(lines, pitch_mm, source)
    sampled, shape, extents = _lattice(np.asarray(image, np.float32), lines, source)
    axes, spans = _axes_and_spans(sampled, shape, extents, lines, x_axis, origin_px, source)
    seen = tuple(len(spans[axis]) for axis in axes.lattice_axes)
    if seen != lines:
        raise _refusal(source, lines, f"{seen[0]} × {seen[1]} lines")
    crossing, sound = _crossings(sampled, shape, spans)
    if np.count_nonzero(sound) < _SUFFICIENT * sound.size:
        raise _refusal(source, lines, f"only {np.count_nonzero(sound)} of {sound.size} intersections")
    index = axes.columns_and_rows(np.argwhere(sound) + np.array([spans[0][0], spans[1][0]]), spans)
    by_row = np.lexsort((index[:, 0], index[:, 1]))
    return GridPoints.on_lattice(
        index[by_row], crossing[sound][by_row], lines, pitch_mm, axes.warnings, axes.orientation
    )


def _lattice(
    grey: Grey, lines: tuple[int, int], source: str
) -> tuple[GridImage, LatticeShape, tuple[range, range]]:
    """Return the image with bright lines, the shape of the lattice of cells, and the extents of its lines.

    Raises `CalibrationError` if the image shows no lattice of cells with lines between them.
    """
    expected_cells = (lines[0] - 1) * (lines[1] - 1)
    cells = find_cells(grey, expected_cells)
    if len(cells.index) < max(_FEWEST_CELLS, expected_cells // 10):
        raise _refusal(source, lines, "no line grid", TargetNotSeen)
    sampled = GridImage(grey, cells.dark_lines)
    shape = LatticeShape.fit(cells.index.astype(np.float64) + 0.5, cells.centre_px)
    extents = line_extents(sampled, shape, cells)
    if not extents[0]:
        got = "cells without lines between them, such as a checkerboard"
        raise _refusal(source, lines, got, TargetNotSeen)
    if cells_are_round(sampled, shape, cells):
        got = "round areas without lines between them, such as dots"
        raise _refusal(source, lines, got, TargetNotSeen)
    return sampled, shape, extents


def lines_seen(grey: Grey) -> tuple[int, int] | None:
    """Return the numbers of lines along both directions of any line grid in the image, or None."""
    cells = find_cells(grey, grey.size)
    if len(cells.index) < _FEWEST_CELLS:
        return None
    sampled = GridImage(grey, cells.dark_lines)
    shape = LatticeShape.fit(cells.index.astype(np.float64) + 0.5, cells.centre_px)
    first, second = (len(extent) for extent in line_extents(sampled, shape, cells))
    if min(first, second) < FEWEST_LINES or cells_are_round(sampled, shape, cells):
        return None
    return (first, second) if len(cells.index) >= _FILLED * (first - 1) * (second - 1) else None


def _require_possible(lines: tuple[int, int], pitch_mm: float, source: str) -> None:
    if min(lines) < FEWEST_LINES or not 0 < pitch_mm < float("inf"):
        raise CalibrationError(
            source,
            "find grid",
            f"at least {FEWEST_LINES} lines in each direction and a positive pitch",
            f"{lines[0]} × {lines[1]} lines of pitch {pitch_mm:g} mm",
            "give the grid's own values, such as --lines 21x21 and --pitch-mm 0.5",
        )


def _crossings(image: GridImage, shape: LatticeShape, extents: tuple[range, range]) -> tuple[Float, Mask]:
    """Return the intersections (n0, n1, 2) in px, and a mask (n0, n1) of the reliable intersections."""
    predicted = shape.map(np.stack(np.meshgrid(*extents, indexing="ij"), axis=-1).astype(float))
    first, second = (trace_lines(image, shape, axis, extents[axis], extents[1 - axis]) for axis in (0, 1))
    crossing, sound = intersect(first, second, predicted)
    pitch_px = float(np.sqrt(abs(np.linalg.det(_lattice_vectors(shape, extents)))))
    sound &= np.linalg.norm(crossing - predicted, axis=-1) < 0.3 * pitch_px
    sound[sound] = fits_lattice(np.argwhere(sound).astype(float), crossing[sound])
    return crossing, sound


def _lattice_vectors(shape: LatticeShape, extents: tuple[range, range]) -> Float:
    """Return the two vectors (2, 2), px, from the middle of the grid to the next intersections."""
    middle = np.array([(span[0] + span[-1]) / 2 if len(span) else 0.0 for span in extents])
    return np.stack([shape.step(middle, 0), shape.step(middle, 1)])


def _axes_and_spans(
    image: GridImage,
    shape: LatticeShape,
    seen: tuple[range, range],
    lines: tuple[int, int],
    x_axis: XAxis,
    origin_px: tuple[float, float] | None,
    source: str,
) -> tuple[Axes, tuple[range, range]]:
    """Return the X and Y axes, and the lattice indices of all lines of the grid.

    The position of a mark, or `origin_px`, determines where hidden outer lines are. If there is no mark and
    no `origin_px`, the grid ends at the visible lines `seen`.
    """
    vectors = _lattice_vectors(shape, seen)
    mark = find_mark(image, shape, seen, vectors, lines)
    if mark is None:
        axes, spans = axes_in_image(vectors, x_axis, source), seen
    else:
        axes, spans = mark.axes, mark.spans
        if x_axis is not None:
            wanted = axes_in_image(vectors, x_axis, source)
            if (wanted.swap, wanted.flip) != (axes.swap, axes.flip):
                got = f"a mark with X in another direction than --x-axis {x_axis}"
                raise _contradiction(source, got, "leave out --x-axis: the mark gives the direction of X")
    if origin_px is not None:
        given = f"--origin-px {origin_px[0]:g} {origin_px[1]:g}"
        near = np.stack(np.meshgrid(*seen, indexing="ij"), axis=-1).reshape(-1, 2)
        away_px = np.linalg.norm(shape.map(near.astype(float)) - np.array(origin_px), axis=1)
        if away_px.min() > 0.4 * np.linalg.norm(vectors, axis=1).min():
            raise _contradiction(source, f"no intersection near {given}", _ORIGIN_REMEDY)
        origin = near[np.argmin(away_px)]
        whole = grid_spans(axes, (int(origin[0]), int(origin[1])), lines)
        if mark is not None and whole != spans:
            raise _contradiction(source, f"a mark at another intersection than {given}", _ORIGIN_REMEDY)
        if not within(seen, whole):
            got = f"lines beyond a grid of {lines[0]} × {lines[1]} lines around {given}"
            raise _contradiction(source, got, _ORIGIN_REMEDY)
        spans = whole
    return axes, spans


def _contradiction(source: str, got: str, remedy: str) -> CalibrationError:
    return CalibrationError(
        source,
        "name the axes",
        "a mark, --origin-px and --x-axis that agree with the image",
        got,
        remedy,
    )


def _refusal(
    source: str, lines: tuple[int, int], got: str, kind: type[CalibrationError] = CalibrationError
) -> CalibrationError:
    expected = f"a grid of {lines[0]} × {lines[1]} lines with at least {_SUFFICIENT:.0%} of its intersections"
    return kind(source, "find grid", expected, got, _REMEDY)
