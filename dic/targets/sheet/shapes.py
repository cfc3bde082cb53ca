"""The dark areas of a calibration target: rectangles and discs, in mm relative to the target's centre.

X points right and Y points up.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np

from dic.targets.find import (
    AsymmetricDotTarget,
    CharucoTarget,
    CheckerboardTarget,
    DotTarget,
    LineGridTarget,
    Target,
)
from dic.typing import Float

# Sizes in pitches: width of a line, length of a line beyond the outermost line, radius of the dots of a line
# grid's mark, radius of a dot, radius of the hole of a hollow dot.
_LINE_WIDTH, _OVERHANG, _MARK_RADIUS = 0.15, 0.2, 0.15
_DOT_RADIUS, _HOLE_RADIUS = 0.28, 0.14
# Number of columns and rows between the rim of a plate of dots and the marks.
_MARKS_FROM_RIM = 2


@dataclass(frozen=True)
class Shapes:
    """The dark areas of a target.

    Attributes
    ----------
    rectangles : ndarray, shape (n, 4)
        Left, bottom, width and height, mm.
    discs : ndarray, shape (m, 3)
        X and Y of the centre, and radius, mm.
    holes : ndarray, shape (k, 3)
        Bright discs within the dark discs.
    """

    rectangles: Float
    discs: Float
    holes: Float

    def size_mm(self) -> tuple[float, float]:
        """Return the width and the height of the target, which is symmetric about its centre."""
        corners = [abs(self.rectangles[:, :2]), abs(self.rectangles[:, :2] + self.rectangles[:, 2:])]
        reach = np.vstack([*corners, abs(self.discs[:, :2]) + self.discs[:, 2:]]).max(axis=0)
        return 2 * float(reach[0]), 2 * float(reach[1])


def shapes_of(target: Target) -> Shapes:
    """Return the dark areas of a target.

    A line grid gets the mark of its origin and axes, and a lattice of at least 7 × 7 dots gets three hollow
    dots. A checkerboard has a dark lower left square.
    """
    none = np.empty((0, 4)), np.empty((0, 3))
    if isinstance(target, LineGridTarget):
        return Shapes(*_line_grid(target), none[1])
    if isinstance(target, DotTarget):
        return Shapes(none[0], *_dots(target))
    if isinstance(target, AsymmetricDotTarget):
        return Shapes(none[0], _shifted_dots(target), none[1])
    cells = _charuco(target) if isinstance(target, CharucoTarget) else _checkerboard(target)
    return Shapes(np.array(cells), none[1], none[1])


def _places(count: int, pitch_mm: float) -> Float:
    places: Float = (np.arange(count, dtype=np.float64) - (count - 1) / 2) * pitch_mm
    return places


def _line_grid(target: LineGridTarget) -> tuple[Float, Float]:
    pitch, width = target.pitch_mm, _LINE_WIDTH * target.pitch_mm
    x, y = (_places(count, pitch) for count in target.lines)
    end_x, end_y = x[-1] + _OVERHANG * pitch, y[-1] + _OVERHANG * pitch
    upright = [(place - width / 2, -end_y, width, 2 * end_y) for place in x]
    level = [(-end_x, place - width / 2, 2 * end_x, width) for place in y]
    middle_x, middle_y = x[target.lines[0] // 2], y[target.lines[1] // 2]
    discs = [
        (middle_x + right * pitch / 2, middle_y + up * pitch / 2, _MARK_RADIUS * pitch)
        for right, up in ((-1, -1), (-1, 1), (1, -1))
    ]
    return np.array(upright + level), np.array(discs)


def _dots(target: DotTarget) -> tuple[Float, Float]:
    pitch = target.pitch_mm
    x, y = (_places(count, pitch) for count in target.dots)
    discs = [(across, up, _DOT_RADIUS * pitch) for across, up in product(x, y)]
    first = _MARKS_FROM_RIM
    if min(target.dots) < 2 * first + 3:
        return np.array(discs), np.empty((0, 3))
    marks = ((x[first], y[first]), (x[-1 - first], y[first]), (x[first], y[-1 - first]))
    return np.array(discs), np.array([(*mark, _HOLE_RADIUS * pitch) for mark in marks])


def _shifted_dots(target: AsymmetricDotTarget) -> Float:
    """Return the dots of an asymmetric grid; the top row begins at the left."""
    half = target.pitch_mm / 2
    x, y = _places(2 * target.dots[0], half), _places(target.dots[1], half)
    # Neighbouring dots are 0.71 pitches apart, so their radius is smaller by this factor.
    radius = _DOT_RADIUS * np.sqrt(2) * half
    return np.array(
        [(across, up, radius) for row, up in enumerate(y[::-1]) for across in x[row % 2 :: 2]], np.float64
    )


def _checkerboard(target: CheckerboardTarget) -> list[tuple[float, ...]]:
    columns, rows = target.squares
    pitch = target.pitch_mm
    return [
        ((column - columns / 2) * pitch, (row - rows / 2) * pitch, pitch, pitch)
        for column, row in product(range(columns), range(rows))
        if (column + row) % 2 == 0
    ]


def _charuco(target: CharucoTarget) -> list[tuple[float, ...]]:
    """Return the dark squares, and the dark modules of the markers, row by row."""
    import cv2

    columns, rows = target.squares
    pitch, side = target.pitch_mm, target.marker_mm
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, target.dictionary))
    board = cv2.aruco.CharucoBoard(target.squares, pitch, side, dictionary)
    # A marker has a dark border around its bits, one module wide.
    modules = dictionary.markerSize + 2
    step = side / modules
    bright: set[tuple[int, int]] = set()
    cells: list[tuple[float, ...]] = []
    corners = np.asarray(board.getObjPoints(), np.float64)[:, 0, :2]
    for number, corner in zip(np.ravel(board.getIds()), corners, strict=True):
        left, top = corner[0] - columns * pitch / 2, rows * pitch / 2 - corner[1]
        bright.add((int(corner[0] / pitch), int(corner[1] / pitch)))
        dark = np.asarray(cv2.aruco.generateImageMarker(dictionary, int(number), modules)) < 128
        for row, across in zip(*np.nonzero(dark), strict=True):
            cells.append((left + across * step, top - (row + 1) * step, step, step))
    cells += [
        ((column - columns / 2) * pitch, (rows / 2 - row - 1) * pitch, pitch, pitch)
        for column, row in product(range(columns), range(rows))
        if (column, row) not in bright
    ]
    return cells
