"""Finding a calibration grid in an image without help.

The way: enclosed cells, on a lattice (`dic.grid_cells`); a smooth map from lattice index to px
(`dic.grid_shape`); how many lines there are (`dic.grid_extent`); line centres, measured across the
lines (`dic.grid_trace`); intersections (`dic.grid_crossings`); which way is X.
"""

import numpy as np
from numpy.typing import NDArray

from dic.errors import CalibrationError
from dic.grid_cells import find_cells
from dic.grid_crossings import intersect
from dic.grid_extent import line_extents
from dic.grid_lines import GridImage
from dic.grid_points import GridPoints
from dic.grid_shape import LatticeShape
from dic.grid_trace import trace_lines

__all__ = ["GridPoints", "find_grid"]

_FEWEST_LINES = 4
_SUFFICIENT = 0.9
_AMBIGUOUS_DEG = 5.0
_REMEDY = (
    "see that the whole grid is in view, sharp and evenly lit, and that --lines says how many lines it has"
)


def find_grid(
    image: NDArray[np.float32],
    lines: tuple[int, int] = (21, 21),
    pitch_mm: float = 0.5,
    source: str = "grid image",
) -> GridPoints:
    """Find the intersections of a line grid, seen from anywhere, to about a hundredth of a pixel.

    Parameters
    ----------
    image : ndarray, shape (height, width)
        Grey levels; dark lines on bright ground or the reverse.
    lines : tuple of int
        Number of lines along X and along Y, at least 4.
    pitch_mm : float
        Distance of neighbouring lines.
    source : str
        The image's file, for messages.

    Returns
    -------
    GridPoints
        At least 90 % of the intersections. X is the grid direction closest to the image's right, Y the one
        closest to its top; if that is ambiguous (near 45°), `warnings` says so.

    Raises
    ------
    CalibrationError
        If the image shows no line grid, another number of lines, or fewer than 90 % of the intersections.
    """
    lines = (int(lines[0]), int(lines[1]))
    _require_possible(lines, pitch_mm, source)
    grey = np.asarray(image, np.float32)
    expected_cells = (lines[0] - 1) * (lines[1] - 1)
    cells = find_cells(grey, expected_cells)
    if len(cells.index) < max(9, expected_cells // 10):
        raise _refusal(source, lines, "no line grid")
    sampled = GridImage(grey, cells.dark_lines)
    shape = LatticeShape.fit(cells.index.astype(np.float64) + 0.5, cells.centre_px)
    extents = line_extents(sampled, shape, cells)
    if not extents[0]:
        raise _refusal(source, lines, "cells without lines between them, such as a checkerboard")
    swap, flip, warnings = _orientation(shape, extents)
    counts = (len(extents[0]), len(extents[1]))
    seen = counts[::-1] if swap else counts
    if seen != lines:
        raise _refusal(source, lines, f"{seen[0]} × {seen[1]} lines")
    crossing, sound = _crossings(sampled, shape, extents)
    if np.count_nonzero(sound) < _SUFFICIENT * sound.size:
        raise _refusal(source, lines, f"only {np.count_nonzero(sound)} of {sound.size} intersections")
    index = np.argwhere(sound)
    if swap:
        index = index[:, ::-1]
    index = np.where(flip, np.array(lines) - 1 - index, index).astype(np.int64)
    by_row = np.lexsort((index[:, 0], index[:, 1]))
    return GridPoints.on_lattice(index[by_row], crossing[sound][by_row], lines, pitch_mm, warnings)


def _require_possible(lines: tuple[int, int], pitch_mm: float, source: str) -> None:
    if min(lines) < _FEWEST_LINES or not 0 < pitch_mm < float("inf"):
        raise CalibrationError(
            source,
            "find grid",
            expected=f"at least {_FEWEST_LINES} lines in each direction and a positive pitch",
            got=f"{lines[0]} × {lines[1]} lines of pitch {pitch_mm:g} mm",
            remedy="correct --lines and --pitch-mm",
        )


def _crossings(
    image: GridImage, shape: LatticeShape, extents: tuple[range, range]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return the intersections (n0, n1, 2) in px and which of them were measured well, (n0, n1)."""
    predicted = shape.map(np.stack(np.meshgrid(*extents, indexing="ij"), axis=-1).astype(float))
    first, second = (trace_lines(image, shape, axis, extents[axis], extents[1 - axis]) for axis in (0, 1))
    crossing, sound = intersect(first, second, predicted)
    pitch_px = float(np.sqrt(abs(np.linalg.det(_lattice_vectors(shape, extents)))))
    sound &= np.linalg.norm(crossing - predicted, axis=-1) < 0.3 * pitch_px
    return crossing, sound & _in_line(crossing, sound)


def _in_line(crossing: NDArray[np.float64], sound: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Tell which intersections lie where the others say, within eight times the usual: dirt bends lines."""
    if np.count_nonzero(sound) < 16:
        return sound
    index = np.argwhere(sound).astype(float)
    deviation = np.linalg.norm(crossing[sound] - LatticeShape.fit(index, crossing[sound]).map(index), axis=1)
    result = sound.copy()
    result[sound] = deviation < 8 * np.median(deviation) + 0.05
    return result


def _lattice_vectors(shape: LatticeShape, extents: tuple[range, range]) -> NDArray[np.float64]:
    """Return the two lattice vectors (2, 2) at the middle of the grid, px."""
    middle = np.array([(span[0] + span[-1]) / 2 if len(span) else 0.0 for span in extents])
    return np.stack([shape.step(middle, 0), shape.step(middle, 1)])


def _orientation(
    shape: LatticeShape, extents: tuple[range, range]
) -> tuple[bool, NDArray[np.bool_], tuple[str, ...]]:
    """Return whether the lattice's axes are to be swapped, which of X and Y to be reversed, and warnings."""
    vectors = _lattice_vectors(shape, extents)
    from_right_deg = np.degrees(np.arctan2(np.abs(vectors[:, 1]), np.abs(vectors[:, 0])))
    swap = bool(from_right_deg[1] < from_right_deg[0])
    x_axis, y_axis = vectors[::-1] if swap else vectors
    flip_x = bool(x_axis[0] < 0)
    # right-handed with Y up: in the image, whose y points down, the cross product is negative
    handed = x_axis[0] * y_axis[1] - x_axis[1] * y_axis[0]
    flip_y = bool((handed > 0) != flip_x)
    warnings: tuple[str, ...] = ()
    if abs(from_right_deg[0] - from_right_deg[1]) < 2 * _AMBIGUOUS_DEG:
        angle = float(min(from_right_deg))
        warnings = (
            f"the grid is turned by about {angle:.0f}° in the image, so that X and Y could be named "
            "the other way round; X was taken along the direction closest to the image's right",
        )
    return swap, np.array([flip_x, flip_y]), warnings


def _refusal(source: str, lines: tuple[int, int], got: str) -> CalibrationError:
    expected = f"a grid of {lines[0]} × {lines[1]} lines with at least {_SUFFICIENT:.0%} of its intersections"
    return CalibrationError(source, "find grid", expected=expected, got=got, remedy=_REMEDY)
