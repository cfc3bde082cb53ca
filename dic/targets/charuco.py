"""Detection of the corners of a ChArUco board.

The markers of the board identify each corner. Therefore a part of the board may be hidden.
"""

import numpy as np

from dic.errors import CalibrationError
from dic.targets.checkerboard import refine
from dic.targets.lattice import fits_lattice
from dic.targets.points import GridPoints
from dic.targets.sampled_image import as_bytes
from dic.typing import Float, Grey, Indices

# Smallest share of the corners that must be visible.
_SUFFICIENT = 0.5
# A corner is refined within a disc. This is its radius as a fraction of the margin around a marker.
_WINDOW_OF_MARGIN = 0.9
_REMEDY = "check that the board is sharp and evenly lit, and that --squares and --dictionary describe it"


def find_charuco(
    grey: Grey,
    squares: tuple[int, int],
    pitch_mm: float,
    marker_side: float,
    dictionary: str,
    source: str,
) -> GridPoints:
    """Return the visible corners of a ChArUco board. `dic.targets.find.CharucoTarget` describes the board.

    At least half of the corners must be visible. On every side of the board, at least one corner in the outer
    third must be visible, because a calibration holds only in the area between its points. The argument
    `marker_side` is the side of a marker divided by the pitch.

    Raises
    ------
    CalibrationError
        If too few corners are visible, or if no corner is visible in the outer third on one side of the
        board.
    """
    import cv2

    lines = (squares[0] - 1, squares[1] - 1)
    number = getattr(cv2.aruco, dictionary)
    board = cv2.aruco.CharucoBoard(squares, 1.0, marker_side, cv2.aruco.getPredefinedDictionary(number))
    corners, ids, _, _ = cv2.aruco.CharucoDetector(board).detectBoard(as_bytes(grey))
    found = 0 if ids is None else len(ids)
    if found < _SUFFICIENT * lines[0] * lines[1]:
        of_board = f"corners of a board of {squares[0]} × {squares[1]} squares with markers of {dictionary}"
        expected = f"at least half of the {lines[0] * lines[1]} {of_board}"
        raise _refusal(source, expected, f"{found} corners")
    number_of = np.asarray(ids, np.int64).ravel()
    # OpenCV numbers the corners row by row from the top left; the index here counts rows from the bottom.
    index = np.column_stack([number_of % lines[0], lines[1] - 1 - number_of // lines[0]])
    thirds = (np.array(lines) - 1) / 3
    if (index.min(axis=0) > thirds).any() or (index.max(axis=0) < 2 * thirds).any():
        expected = "visible corners in the outer third on every side"
        raise _refusal(source, expected, "a side without any", "uncover the board, or turn it into view")
    px = np.asarray(corners, np.float64).reshape(-1, 2)
    margin_px = (1 - marker_side) / 2 * _pitch_px(index, px)
    refined = refine(grey, px, _WINDOW_OF_MARGIN * margin_px)
    sound = fits_lattice(index.astype(float), refined)
    index, refined = index[sound], refined[sound]
    by_row = np.lexsort((index[:, 0], index[:, 1]))
    return GridPoints.on_lattice(index[by_row], refined[by_row], lines, pitch_mm, (), "mark")


def is_dictionary(name: str) -> bool:
    """Return True if OpenCV has a dictionary of markers with this name."""
    import cv2

    return name.startswith("DICT_") and hasattr(cv2.aruco, name)


def _pitch_px(index: Indices, px: Float) -> float:
    """Return the distance between neighbouring corners, px: the smaller of those along X and along Y.

    The distances come from an affine map that is fitted to all corners.
    """
    affine = np.linalg.lstsq(np.column_stack([index, np.ones(len(index))]), px, rcond=None)[0]
    return float(np.linalg.norm(affine[:2], axis=1).min())


def _refusal(source: str, expected: str, got: str, remedy: str = _REMEDY) -> CalibrationError:
    return CalibrationError(source, "find ChArUco board", expected, got, remedy)
