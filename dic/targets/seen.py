"""Name the target that an image shows, for the error message of a finder that did not find its target.

The search takes little time: it uses a reduced image, and it counts lines, squares and dots without measuring
them.
"""

import numpy as np
from numpy.typing import NDArray

from dic.targets.charuco import fit_one_plane, markers_seen
from dic.targets.checkerboard import board_seen
from dic.targets.dots import dots_seen
from dic.targets.kinds import (
    AsymmetricDotTarget,
    CharucoTarget,
    CheckerboardTarget,
    DotTarget,
    LineGridTarget,
)
from dic.targets.kinds.target import SeenTarget
from dic.targets.line_grid.find import lines_seen
from dic.targets.sampled_image import as_bytes
from dic.typing import Float, Grey, Indices

# The image is reduced to at most about this number of pixels.
_ENOUGH_PX2 = 1_000_000
# `_FAMILIES` are the families of marker dictionaries. `_SIZES` are the numbers of markers of a family's
# dictionaries. `_SEARCHED` is the size of the dictionary that is searched first.
_FAMILIES = tuple(f"DICT_{side}X{side}" for side in (4, 5, 6, 7))
_SIZES, _SEARCHED = (50, 100, 250, 1000), 250
_OTHER_DICTIONARIES = ("DICT_ARUCO_ORIGINAL", "DICT_APRILTAG_36h11")
# A board has at least `_FEWEST_MARKERS` markers and at most `_MOST_COLUMNS` columns, and at least the share
# `_FITTING` of the markers must fit it. The side of a marker is assumed to be `_MARKER_SIDE` pitches, which
# is usual.
_FEWEST_MARKERS, _FITTING, _MOST_COLUMNS, _MARKER_SIDE = 4, 0.8, 40, 0.75


def target_seen(grey: Grey) -> SeenTarget | None:
    """Return the target that the image (height, width) shows, or None.

    A ChArUco board is also a checkerboard, and the squares of a checkerboard are the cells of a lattice.
    Therefore the kinds of targets are tried in this order: ChArUco board, checkerboard, line grid, dots. The
    search for markers takes the longest, so a checkerboard without marks in its squares is not searched for
    markers.
    """
    import cv2

    scale = min(1.0, float(np.sqrt(_ENOUGH_PX2 / grey.size)))
    if scale < 1:
        grey = np.asarray(cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA))
    image = as_bytes(grey)
    board = board_seen(image)
    with_markers = _board_with_markers_seen(image) if board is None or board.marked else None
    if with_markers is not None:
        return with_markers
    if board is not None:
        return SeenTarget(CheckerboardTarget, board.squares)
    lines = lines_seen(grey)
    if lines is not None:
        return SeenTarget(LineGridTarget, lines)
    dots = dots_seen(grey)
    if dots is None:
        return None
    return SeenTarget(AsymmetricDotTarget if dots.asymmetric else DotTarget, dots.counts)


def _board_with_markers_seen(image: NDArray[np.uint8]) -> SeenTarget | None:
    """Return the ChArUco board that an 8-bit image shows, of any dictionary and size, or None."""
    # A search takes longer if the dictionary has more markers, so begin with a small dictionary.
    searched = (*(f"{family}_{_SEARCHED}" for family in _FAMILIES), *_OTHER_DICTIONARIES)
    found = {name: markers_seen(image, name) for name in searched}
    name = max(found, key=lambda each: len(found[each][0]))
    number, corners = found[name]
    family = name.rpartition("_")[0]
    if family in _FAMILIES and len(number) >= _FEWEST_MARKERS:
        number, corners = markers_seen(image, f"{family}_{_SIZES[-1]}")
    squares = _squares_of_board(number, corners)
    if squares is None:
        return None
    if family in _FAMILIES:
        name = f"{family}_{next(size for size in _SIZES if size > number.max())}"
    return SeenTarget(CharucoTarget, squares, name)


def _squares_of_board(number: Indices, corners: Float) -> tuple[int, int] | None:
    """Return the numbers of columns and rows of the ChArUco board with the given markers, or None.

    The markers are numbered row by row, so their places give the number of columns. The last visible row
    counts as the last row of the board.

    `number`, shape (n,): numbers of the markers. `corners`, shape (n, 4, 2): corners of the markers in the
    image, px.
    """
    if len(number) < _FEWEST_MARKERS:
        return None
    found = _best_board(number, corners)
    if found is None or found[2] >= 2:
        # A board whose markers do not begin with 0 seems to have hidden rows above, or none that fit.
        found = _best_board(number - number.min(), corners) or found
    return None if found is None else found[:2]


def _best_board(number: Indices, corners: Float) -> tuple[int, int, int] | None:
    """Return the columns, the rows and the first visible row of the board that fits best, or None."""
    import cv2

    misfits = {}
    for columns in range(3, _MOST_COLUMNS + 1):
        for first_is_bright in (False, True):
            drawn, rows, _ = _drawn(number, columns, first_is_bright)
            to_image, _ = cv2.findHomography(drawn.reshape(-1, 2), corners.reshape(-1, 2))
            if to_image is not None and rows >= 3:
                there = cv2.perspectiveTransform(drawn.reshape(-1, 1, 2), to_image).reshape(-1, 4, 2)
                away = np.linalg.norm(there - corners, axis=-1)
                misfits[columns, rows, first_is_bright] = float(np.median(away))
    if not misfits:
        return None
    columns, rows, first_is_bright = min(misfits, key=lambda each: misfits[each])
    fits = fit_one_plane(_drawn(number, columns, first_is_bright)[0], corners)
    first = _drawn(number, columns, first_is_bright)[2]
    return (columns, rows, first) if np.count_nonzero(fits) >= _FITTING * len(number) else None


def _drawn(number: Indices, columns: int, first_is_bright: bool) -> tuple[Float, int, int]:
    """Return the corners (n, 4, 2), pitches, of markers on a board with `columns` columns.

    The function also returns the board's number of rows, and the first row with one of the markers.
    """
    rows = 2 * int(number.max()) // columns + 2
    square = np.add.outer(np.arange(rows), np.arange(columns)) % 2
    row, column = np.nonzero(square == (0 if first_is_bright else 1))
    middle = np.stack([column, -row], axis=-1)[number].astype(np.float64)
    half = _MARKER_SIDE / 2
    around = half * np.array([[-1, 1], [1, 1], [1, -1], [-1, -1]])
    return middle[:, None] + around, int(row[number].max()) + 1, int(row[number].min())
