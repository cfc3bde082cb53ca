"""Detection of the corners of a checkerboard.

OpenCV's detector finds the corners. `dic.targets.corners` then measures them.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from dic.errors import CalibrationError
from dic.targets.axes import Axes, XAxis, axes_in_image
from dic.targets.corners import fit_corners
from dic.targets.dots import dots_seen
from dic.targets.lattice import fits_lattice
from dic.targets.not_seen import TargetNotSeen
from dic.targets.points import GridPoints
from dic.targets.region import two_targets
from dic.targets.sampled_image import as_bytes
from dic.typing import Float, Grey

# Length of the edges around a corner that are used to measure it, in pitches.
_REACH = 0.45
# `_SUFFICIENT` is the smallest share of the corners that must fit the lattice. `_MEASURED` is the smallest
# share for which the fit of crossing edges succeeds. If blur makes this fit fail, the detector's own corners
# are wrong by about a pixel.
_SUFFICIENT, _MEASURED = 0.9, 0.5
# If the surroundings of the corners differ from crossing edges by more than this, the image may show round
# dots, and the function looks for dots. Simulated boards have differences up to 0.02, and dots that nearly
# touch have 0.1. Noise that JPEG has smoothed increases the difference too.
_NO_EDGES = 0.07
# Smallest share of neighbouring squares with alternating colours. A reflection may cover the other squares.
_ALTERNATING = 0.85
# A checkerboard of unknown size has at least this number of corners along each direction.
_FEWEST_CORNERS = (3, 3)
# This number of fitted corners is enough to recognise gaps between dots. The fit of all corners takes much
# longer.
_ENOUGH_CORNERS = 32
# Bright squares are searched for dark marks at `_PLACES`, in pitches from the middle of the square. The
# squares have markers if the share of dark places is above `_MARKED`. The rim of a marker alone gives a
# larger share.
_PLACES = np.linspace(-0.35, 0.35, 7)
_MARKED = 0.05
# Smaller images are searched in more ways, because the search then takes little time.
_SMALL_IMAGE_PX2 = 1_600_000


def find_checkerboard(
    grey: Grey, squares: tuple[int, int], pitch_mm: float, source: str, x_axis: XAxis
) -> GridPoints:
    """Return the inner corners of a checkerboard. `dic.targets.CheckerboardTarget` describes the board.

    The detector (Duda and Frese, "Accurate Detection and Localization of Checkerboard Corners for
    Calibration", BMVC 2018) finds either all corners or none. Refined corners that do not fit the lattice are
    left out of the result.

    Raises `CalibrationError` if the detector does not find the corners, if half of them are too blurred to be
    measured, or if more than 10 % of them do not fit the lattice.
    """
    lines = (squares[0] - 1, squares[1] - 1)
    image = as_bytes(grey)
    px = _detected(image, lines)
    if px is None:
        raise _refusal(source, squares, "no such board", TargetNotSeen)
    other = _detected(_without(image, px), lines, thorough=False)
    if other is not None:
        raise two_targets(source, "checkerboard", (px.reshape(-1, 2), other.reshape(-1, 2)))
    refined, difference = _fitted(grey, px)
    if _are_gaps_between_dots(grey, difference):
        raise _refusal(source, squares, "the gaps between round dots", TargetNotSeen)
    measured = np.asarray(np.isfinite(refined).all(axis=1))
    if np.count_nonzero(measured) < _MEASURED * measured.size:
        got = f"a board of which {np.count_nonzero(measured)} of {measured.size} corners are sharp enough"
        raise _refusal(source, squares, got)
    vectors = np.stack([(px[-1] - px[0]).mean(axis=0), (px[:, -1] - px[:, 0]).mean(axis=0)])
    vectors /= np.array(lines)[:, None] - 1.0
    spans = (range(lines[0]), range(lines[1]))
    first_is_dark = _first_square_is_dark(grey, px)

    def possible(axes: Axes) -> bool:
        if tuple(len(spans[axis]) for axis in axes.lattice_axes) != lines:
            return False
        # Colours alternate, so the colour of one square gives the colour of the lower left square.
        square = axes.columns_and_rows(np.zeros((1, 2), np.int64), spans)[0] - np.array(axes.flip)
        return sum(squares) % 2 == 0 or first_is_dark == (int(square.sum()) % 2 == 0)

    axes = axes_in_image(vectors, x_axis, source, possible)
    index = np.argwhere(np.ones(lines, bool))
    column_row = axes.columns_and_rows(index, spans)
    # Next to the image's rim there is no room for the measurement, so keep the detector's corner.
    refined = np.where(measured[:, None], refined, px.reshape(-1, 2))
    sound = fits_lattice(index.astype(float), refined)
    if np.count_nonzero(sound) < _SUFFICIENT * sound.size:
        got = f"only {np.count_nonzero(sound)} of {sound.size} corners"
        raise _refusal(source, squares, got)
    column_row, refined = column_row[sound], refined[sound]
    by_row = np.lexsort((column_row[:, 0], column_row[:, 1]))
    return GridPoints.on_lattice(
        column_row[by_row], refined[by_row], lines, pitch_mm, axes.warnings, axes.orientation
    )


@dataclass(frozen=True)
class SeenBoard:
    """A checkerboard of unknown size in an image."""

    squares: tuple[int, int]
    """Numbers of squares along both directions."""
    marked: bool
    """True if the bright squares have dark marks inside, like the markers of a ChArUco board."""


def board_seen(image: NDArray[np.uint8]) -> SeenBoard | None:
    """Return any checkerboard in an 8-bit image, or None."""
    import cv2

    flags = cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_LARGER
    found, corners, meta = cv2.findChessboardCornersSBWithMeta(image, _FEWEST_CORNERS, flags)
    if not found:
        return None
    rows, columns = np.asarray(meta).shape[:2]
    px = np.asarray(corners, np.float64).reshape(rows, columns, 2).transpose(1, 0, 2)
    # The detector sometimes mistakes the outer ends of the squares at the rim for a row of corners.
    for left, right, top, bottom in sorted(product((0, 1), repeat=4), key=sum):
        part = px[left : columns - right, top : rows - bottom]
        if min(part.shape[:2]) >= min(_FEWEST_CORNERS) and _colours_alternate(image, part):
            grey = image.astype(np.float32)
            if _are_gaps_between_dots(grey, _fitted(grey, part, _ENOUGH_CORNERS)[1]):
                return None
            return SeenBoard((part.shape[0] + 1, part.shape[1] + 1), _are_marked(grey, part))
    return None


def _detected(image: NDArray[np.uint8], lines: tuple[int, int], thorough: bool = True) -> Float | None:
    """Return the corners that OpenCV's detector finds, shape (columns, rows, 2), px, or None.

    The detector finds small squares more often if the image is enlarged first. With the flag
    `CALIB_CB_ACCURACY`, the detector enlarges the image itself, but then it misses small squares. Therefore
    the first attempt is made without that flag. A large image is not enlarged.
    """
    import cv2

    height, width = image.shape
    plain = cv2.CALIB_CB_EXHAUSTIVE
    accurate = plain | cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_NORMALIZE_IMAGE
    attempts = [(1.0, plain)]
    if height * width <= _SMALL_IMAGE_PX2:
        attempts = [(1.0, plain), (2.0, plain), (1.0, accurate), (1.0, 0)]
    for scale, flags in attempts if thorough else attempts[:1]:
        method = cv2.INTER_CUBIC
        scaled = image if scale == 1 else cv2.resize(image, None, fx=scale, fy=scale, interpolation=method)
        found, corners = cv2.findChessboardCornersSB(scaled, lines, flags=flags)
        if found:
            px = (np.asarray(corners, np.float64).reshape(lines[1], lines[0], 2) + 0.5) / scale - 0.5
            # From here on, the first index is the column.
            px = px.transpose(1, 0, 2)
            if _colours_alternate(image, px) and not _continues(image, px):
                return px
    return None


def _fitted(grey: Grey, px: Float, most: int | None = None) -> tuple[Float, float]:
    """Return the result of `fit_corners` for detected corners (columns, rows, 2), px.

    If `most` is given, at most this number of corners is fitted. These corners are spread over the board.
    """
    along = np.stack([np.gradient(px, axis=0), np.gradient(px, axis=1)], axis=-2).reshape(-1, 2, 2)
    corners = px.reshape(-1, 2)
    some = np.linspace(0, len(corners) - 1, min(most or len(corners), len(corners))).astype(int)
    return fit_corners(grey, corners[some], along[some], _REACH)


def _are_gaps_between_dots(grey: Grey, difference: float) -> bool:
    """Return True if the detected corners are not corners but gaps between round dots.

    The gaps between the dots of an asymmetric grid are bright and dark in turn, like the squares of a
    checkerboard. `difference` is the difference between the corners' surroundings and crossing edges.
    """
    return difference > _NO_EDGES and dots_seen(grey) is not None


def _are_marked(grey: Grey, px: Float) -> bool:
    """Return True if bright squares between the corners (columns, rows, 2), px, have dark marks inside."""
    across, up = (_PLACES + 0.5)[:, None], (_PLACES + 0.5)[None]
    weights = np.stack([(1 - across) * (1 - up), across * (1 - up), (1 - across) * up, across * up])
    ends = np.stack([px[:-1, :-1], px[1:, :-1], px[:-1, 1:], px[1:, 1:]])
    column, row = np.rint(np.einsum("kxy,kijd->dijxy", weights, ends)).astype(int)
    height, width = grey.shape
    level = grey[np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)]
    even = np.add.outer(np.arange(level.shape[0]), np.arange(level.shape[1])) % 2 == 0
    # A bright square has bright places even if there is a marker inside.
    brightest = np.quantile(level, 0.9, axis=(2, 3))
    bright = even == (brightest[even].mean() > brightest[~even].mean())
    halfway = (brightest[bright] + np.median(brightest[~bright])) / 2
    return bool(np.median((level[bright] < halfway[:, None, None]).mean(axis=(1, 2))) > _MARKED)


def _without(image: NDArray[np.uint8], px: Float) -> NDArray[np.uint8]:
    """Return the image with the board of the given corners (columns, rows, 2), px, painted over."""
    import cv2

    around = np.pad(px, ((1, 1), (1, 1), (0, 0)), mode="reflect", reflect_type="odd")
    outline = cv2.convexHull(np.rint(around.reshape(-1, 2)).astype(np.int32))
    return np.asarray(cv2.fillConvexPoly(image.copy(), outline, float(np.median(image))))


def _colours_alternate(image: NDArray[np.uint8], px: Float) -> bool:
    """Return True if squares lie around all corners (columns, rows, 2), px, in alternating colours.

    The detector sometimes mistakes the outer ends of the squares at the rim of the board for a row of
    corners. There are no squares beyond such a row.
    """
    level, sign = _levels_of_squares(image, px, 1)
    # The difference between a square and its neighbour along one direction.
    steps = (sign[1:] * (level[1:] - level[:-1]), sign[:, 1:] * (level[:, 1:] - level[:, :-1]))
    every = np.concatenate([step.ravel() for step in steps])
    right, usual = np.sign(np.nanmedian(every)), float(np.nanmedian(np.abs(every)))
    parts = (*steps, steps[0][0], steps[0][-1], steps[1][:, 0], steps[1][:, -1])
    seen = [part[np.isfinite(part)] for part in parts]
    return all(not len(part) or float((right * part > 0.2 * usual).mean()) > _ALTERNATING for part in seen)


def _continues(image: NDArray[np.uint8], px: Float) -> bool:
    """Return True if the board has squares beyond those around the corners (columns, rows, 2), px.

    If the given numbers of squares are too small, the detector sometimes finds a part of a larger board.
    """
    level, sign = _levels_of_squares(image, px, 2)
    whole, even = level[2:-2, 2:-2], sign[2:-2, 2:-2] > 0
    contrast = float(whole[even].mean() - whole[~even].mean())
    ends = [0, -1]
    for side, signs in zip((*level[ends], *level.T[ends]), (*sign[ends], *sign.T[ends]), strict=True):
        steps = (signs[1:-2] * (side[1:-2] - side[2:-1])) / contrast
        seen = steps[np.isfinite(steps)]
        if len(seen) > len(steps) / 2 and float((seen > 0.4).mean()) > _ALTERNATING:
            return True
    return False


def _levels_of_squares(image: NDArray[np.uint8], px: Float, rings: int) -> tuple[Float, Float]:
    """Return the grey levels of the squares around all corners (columns, rows, 2), px, and their signs.

    The result includes `rings` rings of squares outside the outermost corners. The signs alternate from
    square to square. The level is NaN for squares that the edge of the image cuts.
    """
    around = np.pad(px, ((rings, rings), (rings, rings), (0, 0)), mode="reflect", reflect_type="odd")
    centre = (around[:-1, :-1] + around[1:, :-1] + around[:-1, 1:] + around[1:, 1:]) / 4
    column, row = np.rint(centre).astype(int).transpose(2, 0, 1)
    height, width = image.shape
    inside = (column >= 0) & (row >= 0) & (column < width) & (row < height)
    level = image[np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)].astype(np.float64)
    level[~inside] = np.nan
    sign = np.where(np.add.outer(np.arange(level.shape[0]), np.arange(level.shape[1])) % 2 == 0, 1.0, -1.0)
    return level, sign


def _refusal(
    source: str, squares: tuple[int, int], got: str, kind: type[CalibrationError] = CalibrationError
) -> CalibrationError:
    return kind(
        source,
        "find checkerboard",
        f"a checkerboard of {squares[0]} × {squares[1]} squares, all of it in view",
        got,
        "check that it is sharp, evenly lit and not covered, and that --squares counts all its squares",
    )


def _first_square_is_dark(grey: Grey, px: Float) -> bool:
    """Return True if the square diagonally outside the first inner corner is dark.

    The function compares the mean grey levels of the two colours over all squares.
    """
    centre = (px[:-1, :-1] + px[1:, :-1] + px[:-1, 1:] + px[1:, 1:]) / 4
    column, row = np.rint(centre).astype(int).transpose(2, 0, 1)
    level = grey[row, column]
    even = np.add.outer(np.arange(level.shape[0]), np.arange(level.shape[1])) % 2 == 0
    # Two squares that meet only at a corner have the same colour.
    return bool(level[even].mean() < level[~even].mean())
