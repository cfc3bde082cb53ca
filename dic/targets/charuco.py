"""Detection of the corners of a ChArUco board.

The markers of the board identify each corner. Therefore a part of the board may be hidden. OpenCV finds the
markers. The corners of nearby markers predict where the corners of the squares are. `dic.targets.corners`
then measures the corners of the squares.
"""

from difflib import get_close_matches

import numpy as np
from numpy.typing import NDArray

from dic.errors import CalibrationError
from dic.targets.corners import fit_corners
from dic.targets.lattice import fits_lattice
from dic.targets.not_seen import TargetNotSeen
from dic.targets.points import GridPoints
from dic.targets.region import two_targets
from dic.targets.sampled_image import as_bytes
from dic.typing import Float, Grey, Indices, Mask

# Smallest share of the corners that must be visible.
_SUFFICIENT = 0.5
_FEWEST_MARKERS = 2
# Length of the edges around a corner that are used to measure it, in pitches.
_LENGTH = 0.45
# At most `_NEARBY` markers predict a corner. The nearest of them must be at most `_REACH` pitches away.
_NEARBY, _REACH = 4, 1.3
# Smallest contrast between the dark and the bright squares around a corner, as a fraction of the median.
_CONTRAST = 0.4
# Markers beyond the rim belong to a larger board if they are at most `_BEYOND` pitches away from the rim. In
# addition, their place in the square and their size must be right within the fraction `_OFF_MIDDLE`.
_BEYOND, _OFF_MIDDLE = 2.0, 0.2
# An image up to this size is also searched at twice its size, which shows small markers.
_SMALL_IMAGE_PX2 = 1_600_000
_SMALLEST_MARKER_PX = 8
_STEP = "find ChArUco board"
_REMEDY = "check that the board is sharp and evenly lit, and that --squares and --dictionary describe it"


def find_charuco(
    grey: Grey,
    squares: tuple[int, int],
    pitch_mm: float,
    marker_side: float,
    dictionary: str,
    source: str,
) -> GridPoints:
    """Return the visible corners of a ChArUco board. `dic.targets.CharucoTarget` describes the board.

    At least half of the corners must be visible. On every side of the board, at least one corner in the outer
    third must be visible, because a calibration is valid only in the area between its points. The argument
    `marker_side` is the side of a marker divided by the pitch.

    Raises `CalibrationError` if too few corners are visible, or if no corner is visible in the outer third on
    one side of the board.
    """
    lines = (squares[0] - 1, squares[1] - 1)
    image = as_bytes(grey)
    wanted = f"corners of a board of {squares[0]} × {squares[1]} squares with markers of {dictionary}"
    expected = f"at least half of the {lines[0] * lines[1]} {wanted}"
    number, corners, place, marker_px = _markers_on_board(image, squares, marker_side, dictionary)
    if len(place) < _FEWEST_MARKERS and _first_is_hidden(number, squares[0] * squares[1] // 2):
        got = f"the markers {number.min()} to {number.max()} of a board that does not begin with marker 0"
        remedy = "uncover its first and its last marker, which show where it begins, or correct --squares"
        raise CalibrationError(source, _STEP, expected, got, remedy)
    if len(place) < _FEWEST_MARKERS:
        raise TargetNotSeen(source, _STEP, expected, f"{len(place)} markers of this board", _REMEDY)
    again = _second_board(number, corners, marker_px)
    if again is not None:
        raise two_targets(source, "ChArUco board", (marker_px.reshape(-1, 2), again))
    if _goes_on(place, marker_px, corners, squares):
        got = "a larger board, with markers beyond these squares"
        raise TargetNotSeen(source, _STEP, expected, got, _REMEDY)
    # From here on, positions on the board are in pitches. Y points up, and the lower left corner is the
    # origin.
    index = np.argwhere(np.ones(lines, bool))
    px, along, near = _predicted(place, marker_px, (index + 1).astype(np.float64))
    px[near], _ = fit_corners(grey, px[near], along[near], _LENGTH, (1 - marker_side) / 2)
    seen = near & np.isfinite(px).all(axis=1)
    if seen.any():
        seen[seen] = _between_squares(image, index[seen], px[seen], marker_side)
    seen[seen] = fits_lattice(index[seen].astype(float), px[seen])
    found = int(np.count_nonzero(seen))
    if found < _SUFFICIENT * len(index):
        raise TargetNotSeen(source, _STEP, expected, f"{found} corners", _REMEDY)
    thirds = (np.array(lines) - 1) / 3
    if (index[seen].min(axis=0) > thirds).any() or (index[seen].max(axis=0) < 2 * thirds).any():
        expected = "visible corners in the outer third on every side"
        remedy = "uncover the board, or turn it into view"
        raise CalibrationError(source, _STEP, expected, "a side without any", remedy)
    index, px = index[seen], px[seen]
    by_row = np.lexsort((index[:, 0], index[:, 1]))
    return GridPoints.on_lattice(index[by_row], px[by_row], lines, pitch_mm, (), "mark")


def is_dictionary(name: str) -> bool:
    """Return True if OpenCV has a dictionary of markers with this name."""
    import cv2

    return name.startswith("DICT_") and hasattr(cv2.aruco, name)


def nearest_dictionary(name: str) -> str:
    """Return the name of OpenCV's dictionary that is most like a name, such as DICT_4X4_250 for 4x4_250."""
    import cv2

    known = [each for each in dir(cv2.aruco) if each.startswith("DICT_")]
    wanted = f"DICT_{str(name).upper().removeprefix('DICT_')}"
    return next(iter(get_close_matches(wanted, known, 1, 0.8)), "DICT_5X5_100")


def _markers_on_board(
    image: NDArray[np.uint8], squares: tuple[int, int], marker_side: float, dictionary: str
) -> tuple[Indices, Float, Float, Float]:
    """Return all markers found, and those that fit the board.

    For boards with an even number of rows, OpenCV before version 4.6 exchanged the dark and the bright
    squares. The function tries both patterns and takes the pattern that fits more markers.

    Returns
    -------
    number : ndarray of int64, shape (m,)
        Numbers of all markers found.
    corners : ndarray, shape (m, 4, 2)
        Corners of all markers found, in the image, px.
    place, marker_px : ndarray, shape (n, 4, 2)
        Corners of the markers that fit the board. `place` is on the board, in pitches; `marker_px` is in the
        image.
    """
    import cv2

    scales = (1.0, 2.0) if image.size <= _SMALL_IMAGE_PX2 else (1.0,)
    none = np.empty((0, 4, 2))
    best = np.empty(0, np.int64), none, none, none
    possible = squares[0] * squares[1] // 2
    for scale in scales:
        scaled = image if scale == 1 else cv2.resize(image, None, fx=scale, fy=scale)
        number, corners = markers_seen(scaled, dictionary)
        corners = (corners + 0.5) / scale - 0.5
        if len(number) > len(best[0]) and not len(best[2]):
            best = number, corners, none, none
        for first in _first_numbers(number, possible):
            for legacy in (False, True):
                at_number = _drawn_markers(squares, marker_side, dictionary, first, legacy=legacy)
                known = np.array([which in at_number for which in number.tolist()], bool)
                drawn = np.array([at_number[which] for which in number[known].tolist()]).reshape(-1, 4, 2)
                fits = fit_one_plane(drawn, corners[known])
                if np.count_nonzero(fits) > len(best[2]):
                    best = number, corners, drawn[fits], corners[known][fits]
        if len(best[2]) > 0.8 * possible:
            break
    return best


def _first_numbers(number: Indices, possible: int) -> list[int]:
    """Return the numbers that the first marker of a board with `possible` markers may have.

    Boards begin with 0. A laboratory with several boards numbers each from where the one before ended. Then
    the first number is certain only if the first and the last marker are seen: otherwise the board could be
    shifted by some rows.
    """
    if not len(number) or int(number.max()) < possible:
        return [0]
    return [0, int(number.min())] if int(np.ptp(number)) == possible - 1 else [0]


def _first_is_hidden(number: Indices, possible: int) -> bool:
    """Return whether the markers are those of a part of a board that does not begin with marker 0."""
    enough = len(number) >= _FEWEST_MARKERS and int(number.max()) >= possible
    return enough and int(np.ptp(number)) < possible - 1


def _drawn_markers(
    squares: tuple[int, int], marker_side: float, dictionary: str, first: int, *, legacy: bool
) -> dict[int, Float]:
    """Return the corners (4, 2) of each marker of a board as drawn, in pitches, by the marker's number."""
    import cv2

    known = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary))
    board = cv2.aruco.CharucoBoard(squares, 1.0, marker_side, known)
    board.setLegacyPattern(legacy)
    corners = np.asarray(board.getObjPoints(), np.float64)[:, :, :2]
    # OpenCV's Y axis points down, and its origin is the upper left corner.
    corners = corners * [1, -1] + [0, squares[1]]
    numbers = np.ravel(board.getIds()) + first
    return dict(zip(numbers.tolist(), corners, strict=True))


def markers_seen(image: NDArray[np.uint8], dictionary: str) -> tuple[Indices, Float]:
    """Return the numbers (n,) of the markers found, and their corners (n, 4, 2), px."""
    import cv2

    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    # Do not search for smaller markers. In a noisy image this takes many seconds, and the code in a marker of
    # 8 px cannot be read.
    parameters.minMarkerPerimeterRate = max(0.01, 4 * _SMALLEST_MARKER_PX / max(image.shape))
    known = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary))
    corners, numbers, _ = cv2.aruco.ArucoDetector(known, parameters).detectMarkers(image)
    if numbers is None or not len(corners):
        return np.empty(0, np.int64), np.empty((0, 4, 2))
    return np.ravel(np.asarray(numbers, np.int64)), np.asarray(corners, np.float64).reshape(-1, 4, 2)


def _second_board(number: Indices, corners: Float, marker_px: Float) -> Float | None:
    """Return the centres (n, 2), px, of markers away from the board that repeat its numbers, or None."""
    centre = corners.mean(axis=1)
    away = np.linalg.norm(centre[:, None] - marker_px.mean(axis=1), axis=-1).min(axis=1, initial=np.inf)
    elsewhere = away > np.linalg.norm(marker_px[0, 1] - marker_px[0, 0])
    repeated = elsewhere & np.isin(number, number[~elsewhere])
    return centre[repeated] if np.count_nonzero(repeated) >= max(2, len(marker_px) // 2) else None


def _goes_on(place: Float, marker_px: Float, corners: Float, squares: tuple[int, int]) -> bool:
    """Return True if markers lie in squares beyond the rim of the board, as on a larger board.

    A board with more rows has the same markers in the same places, but its centre is elsewhere, so X and Y
    would be wrong. A marker counts only if it lies in the middle of a square and is as large as the board's
    markers.

    `place`, `marker_px`, shape (n, 4, 2): corners of the board's markers on the board, pitches, and in the
    image, px. `corners`, shape (m, 4, 2): corners of all markers in the image, px.
    """
    import cv2

    to_board, _ = cv2.findHomography(marker_px.reshape(-1, 2), place.reshape(-1, 2))
    if to_board is None or not len(corners):
        return False
    there = cv2.perspectiveTransform(corners.reshape(-1, 1, 2), to_board).reshape(-1, 4, 2)
    centre = there.mean(axis=1)
    beyond = ((centre < 0) | (centre > squares)).any(axis=1)
    near = ((centre > -_BEYOND) & (centre < np.array(squares) + _BEYOND)).all(axis=1)
    in_square = (np.abs(centre - np.floor(centre) - 0.5) < _OFF_MIDDLE).all(axis=1)
    side, usual = (np.linalg.norm(each[:, 1] - each[:, 0], axis=-1) for each in (there, place))
    alike = np.abs(side / usual.mean() - 1) < _OFF_MIDDLE
    return bool(np.count_nonzero(beyond & near & in_square & alike) >= max(1, min(squares) // 4))


def fit_one_plane(drawn: Float, corners: Float) -> Mask:
    """Return True for each marker (n,) at its place on the board; the board must be roughly plane."""
    import cv2

    if not len(drawn):
        return np.zeros(0, bool)
    tolerance_px = 3.0 + 0.3 * float(np.median(np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1)))
    flat, px = drawn.reshape(-1, 2), corners.reshape(-1, 2)
    homography, agrees = cv2.findHomography(flat, px, cv2.RANSAC, tolerance_px)
    if homography is None:
        return np.zeros(len(drawn), bool)
    return np.asarray(np.ravel(agrees).astype(bool).reshape(-1, 4).all(axis=1))


def _predicted(place: Float, marker_px: Float, corner: Float) -> tuple[Float, Float, Mask]:
    """Return where corners of squares (n, 2), in pitches, are in the image, and which have a marker nearby.

    The function returns three arrays: the corners in the image, the vectors (n, 2, 2), px, along the edges to
    the neighbouring corners, and the mask. A homography through the corners of the nearest markers predicts
    each corner. Because the homography is local, lens distortion does no harm.
    """
    import cv2

    centre = place.mean(axis=1)
    px, along = np.full(corner.shape, np.nan), np.full((*corner.shape, 2), np.nan)
    around = np.array([[0.0, 0.0], [-0.5, 0.0], [0.5, 0.0], [0.0, -0.5], [0.0, 0.5]])
    away = np.linalg.norm(corner[:, None] - centre, axis=-1)
    near = away.min(axis=1) < _REACH
    for k in np.flatnonzero(near):
        some = np.argsort(away[k])[:_NEARBY]
        homography, _ = cv2.findHomography(place[some].reshape(-1, 2), marker_px[some].reshape(-1, 2))
        if homography is None:
            near[k] = False
            continue
        seen = cv2.perspectiveTransform((corner[k] + around)[:, None], homography)[:, 0]
        px[k], along[k] = seen[0], (seen[2] - seen[1], seen[4] - seen[3])
    return px, along, near


def _between_squares(image: NDArray[np.uint8], index: Indices, px: Float, marker_side: float) -> Mask:
    """Return True for each corner (n,) that lies between two dark and two bright squares.

    The function compares grey levels in the margin around the markers. A hidden corner does not have this
    contrast between its four squares.
    """
    import cv2

    shift = (1 - marker_side) / 4
    smooth = cv2.GaussianBlur(image, (0, 0), 0.7).astype(np.float64)
    affine = np.linalg.lstsq(np.column_stack([index, np.ones(len(index))]), px, rcond=None)[0][:2]
    quadrants = []
    for towards in ((1, 1), (-1, 1), (-1, -1), (1, -1)):
        x, y = np.rint(px + shift * np.array(towards) @ affine).astype(int).T
        quadrants.append(smooth[np.clip(y, 0, image.shape[0] - 1), np.clip(x, 0, image.shape[1] - 1)])
    one, two, three, four = quadrants
    # The opposite squares `one` and `three` must both be darker, or both brighter, than `two` and `four`.
    # Which pair is the darker one alternates from corner to corner.
    sign = np.where(index.sum(axis=1) % 2 == 0, 1.0, -1.0)
    contrast = sign * np.stack([one - two, one - four, three - two, three - four])
    usual = float(np.median(contrast))
    return np.asarray((contrast * np.sign(usual) > _CONTRAST * abs(usual)).all(axis=0))
