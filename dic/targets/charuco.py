"""Corners of a ChArUco board: its markers number them, so much of the board may be hidden."""

import numpy as np
from numpy.typing import NDArray

from dic.errors import CalibrationError
from dic.targets.checkerboard import as_bytes, refine
from dic.targets.lattice import in_line
from dic.targets.points import GridPoints

_SUFFICIENT = 0.5
_WINDOW_OF_MARGIN = 0.9


def find_charuco(
    grey: NDArray[np.float32],
    squares: tuple[int, int],
    pitch_mm: float,
    marker_side: float,
    dictionary: str,
    source: str,
) -> GridPoints:
    """Return the corners of a ChArUco board that are seen; see `dic.targets.find.CharucoTarget`.

    `marker_side` is a marker's side in pitches. A calibration holds only between its points, so at least half
    of the corners must be seen, and some in the outer third on every side.

    Raises
    ------
    CalibrationError
        If the dictionary is unknown, or too little of the board is seen.
    """
    import cv2

    number = getattr(cv2.aruco, dictionary, None) if dictionary.startswith("DICT_") else None
    lines = (squares[0] - 1, squares[1] - 1)
    if number is None:
        raise _refusal(source, "a dictionary of OpenCV, such as DICT_5X5_100", dictionary)
    board = cv2.aruco.CharucoBoard(squares, 1.0, marker_side, cv2.aruco.getPredefinedDictionary(number))
    corners, ids, _, _ = cv2.aruco.CharucoDetector(board).detectBoard(as_bytes(grey))
    found = 0 if ids is None else len(ids)
    if found < _SUFFICIENT * lines[0] * lines[1]:
        raise _refusal(
            source, f"a ChArUco board of {squares[0]} × {squares[1]} squares, half of its corners", str(found)
        )
    number_of = np.asarray(ids, np.int64).ravel()
    # OpenCV numbers corners from the top left, row by row downwards
    index = np.column_stack([number_of % lines[0], lines[1] - 1 - number_of // lines[0]])
    thirds = (np.array(lines) - 1) / 3
    if (index.min(axis=0) > thirds).any() or (index.max(axis=0) < 2 * thirds).any():
        raise _refusal(source, "corners in the outer third on every side", "a side that is hidden")
    px = np.asarray(corners, np.float64).reshape(-1, 2)
    margin_px = (1 - marker_side) / 2 * _pitch_px(index, px)
    refined = refine(grey, px, _WINDOW_OF_MARGIN * margin_px)
    sound = in_line(index.astype(float), refined)
    index, refined = index[sound], refined[sound]
    by_row = np.lexsort((index[:, 0], index[:, 1]))
    return GridPoints.on_lattice(index[by_row], refined[by_row], lines, pitch_mm, (), "mark")


def _pitch_px(index: NDArray[np.int64], px: NDArray[np.float64]) -> float:
    """Return the shorter of the two lattice vectors, by an affine map through all corners."""
    affine = np.linalg.lstsq(np.column_stack([index, np.ones(len(index))]), px, rcond=None)[0]
    return float(np.linalg.norm(affine[:2], axis=1).min())


def _refusal(source: str, expected: str, got: str) -> CalibrationError:
    return CalibrationError(
        source,
        "find ChArUco board",
        expected,
        got,
        "see that the board is sharp and evenly lit, and that its description is right",
    )
