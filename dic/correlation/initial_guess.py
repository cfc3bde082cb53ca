"""The first guess: where a few subsets of the reference are in the deformed image.

`guesses` yields likely and cheap guesses first. `search` compares templates at whole pixels, after it has
moved the deformed image back by an expected motion: none, the shift of the whole image, or the stage's angle.
Large rotations and displacements are found by features (`dic.correlation.features`). Every guess is a warp,
and only IC-GN decides whether it is right.
"""

from collections.abc import Iterator

import numpy as np

from dic.correlation.features import FeatureFinder
from dic.errors import CorrelationError
from dic.image.threads import bands_of, in_parallel
from dic.typing import Float, Grey, Indices

SEARCH_RADII_PX = (24, 80, 200)
"""Search radii, tried in this order until enough seeds converge."""

_TEMPLATES_PER_TASK = 4
"""Templates that a thread searches before it takes the next ones."""

_SMALLEST_TEMPLATE_RADIUS_PX = 3

_SHIFT_SIDE_PX = 512
"""The shift of the whole image is measured in images shrunk to this width or height."""


def guesses(
    reference: Grey,
    deformed: Grey,
    features: FeatureFinder,
    points: Indices,
    half_px: int,
    *,
    previous: Float | None = None,
    hint: Float | None = None,
    threads: int = 1,
) -> Iterator[tuple[str, Float]]:
    """Yield named guesses, warps (n, 6) at `points` (n, 2), the most likely and cheapest first.

    Parameters
    ----------
    reference, deformed : ndarray, shape (height, width)
    features : FeatureFinder
        Of the reference.
    points : ndarray of int, shape (n, 2)
    half_px : int
        Templates are 2 * half_px + 1 wide.
    previous : ndarray, shape (n, 6), optional
        The warps of the step before.
    hint : ndarray, shape (3, 3), optional
        Expected homography from the reference to the deformed image.
    threads : int
    """

    def found_around(motion: Float, radius_px: int) -> Float:
        return search(reference, deformed, points, half_px, radius_px, motion, threads)

    small, middle, large = SEARCH_RADII_PX
    if hint is not None:
        for radius in SEARCH_RADII_PX:
            yield "hint", found_around(hint, radius)
    if previous is not None:
        yield "previous", previous
    yield "search", found_around(np.eye(3), small)
    shift = whole_shift(reference, deformed)
    if np.hypot(shift[0, 2], shift[1, 2]) > small / 2:
        yield "search", found_around(shift, small)
    yield "search", found_around(np.eye(3), middle)
    for matches in features.find(deformed):
        yield "features", matches.warps_at(points.astype(np.float64))
    yield "search", found_around(np.eye(3), large)


def whole_shift(reference: Grey, deformed: Grey) -> Float:
    """Return the shift of the whole image as a homography (3, 3), in whole pixels, by phase correlation.

    C. Kuglin, D. Hines, "The phase correlation image alignment method", IEEE Conference on Cybernetics and
    Society (1975) 163-165.
    """
    import cv2

    height, width = reference.shape
    shrink = max(1.0, max(height, width) / _SHIFT_SIDE_PX)
    size = (round(width / shrink), round(height / shrink))
    here, there = (cv2.resize(image, size, interpolation=cv2.INTER_AREA) for image in (reference, deformed))
    # Without a window the edges of the image, which do not move, would determine the shift.
    (x, y), _ = cv2.phaseCorrelate(here, there, cv2.createHanningWindow(size, cv2.CV_32F))
    return np.array(
        [[1.0, 0.0, round(x * width / size[0])], [0.0, 1.0, round(y * height / size[1])], [0, 0, 1]]
    )


def rigid_motion(angle_deg: float, shift_px: tuple[float, float], centre_px: tuple[float, float]) -> Float:
    """Return the homography of a rotation about a centre followed by a shift.

    Parameters
    ----------
    angle_deg : float
        Positive from x, to the right, towards y, **up**, as rotations are reported.
    shift_px : (float, float)
        To the right and down.
    centre_px : (float, float)
        Column and row.
    """
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    rotation = np.array([[c, s], [-s, c]])
    centre = np.array(centre_px)
    motion = np.eye(3)
    motion[:2, :2], motion[:2, 2] = rotation, centre + np.array(shift_px) - rotation @ centre
    return motion


def checked_homography(hint: object) -> Float:
    """Return an expected motion as an array (3, 3).

    Raises
    ------
    CorrelationError
        If it is not one of finite numbers.
    """
    try:
        motion = np.array(hint, np.float64)
        got = f"an array of shape {motion.shape}"
    except (TypeError, ValueError):
        motion, got = np.empty(0), f"a {type(hint).__name__}"
    if motion.shape == (3, 3):
        if np.isfinite(motion).all() and motion[2, 2]:
            return motion
        got = "one that takes points to infinity"
    raise CorrelationError(
        "hint",
        "expect motion",
        "a homography of shape (3, 3)",
        got,
        "give the homography that dic.rigid_motion returns",
    )


def homography_warps(homography: Float, points: Float) -> Float:
    """Return the affine warps (n, 6) of a homography at `points` (n, 2).

    Parameters
    ----------
    homography : ndarray, shape (3, 3)
        Takes (x, y, 1) of the reference to the deformed image, in pixels.
    points : ndarray, shape (n, 2)
    """
    x, y = points[:, 0], points[:, 1]
    (a, b, c), (d, e, f), (g, h, k) = homography
    w = g * x + h * y + k
    X, Y = (a * x + b * y + c) / w, (d * x + e * y + f) / w
    columns = [X - x, (a - g * X) / w - 1, (b - h * X) / w, Y - y, (d - g * Y) / w, (e - h * Y) / w - 1]
    return np.stack(columns, axis=1)


def search(
    reference: Grey,
    deformed: Grey,
    points: Indices,
    half_px: int,
    radius_px: int,
    motion: Float,
    threads: int = 1,
) -> Float:
    """Find subsets at whole pixels by normalised cross-correlation around an expected motion.

    Parameters
    ----------
    reference, deformed : ndarray, shape (height, width)
    points : ndarray of int, shape (n, 2)
        Centres (x, y) of the templates in the reference.
    half_px : int
        A template is 2 * half_px + 1 wide.
    radius_px : int
        Largest distance of the displacements from those of `motion`.
    motion : ndarray, shape (3, 3)
        Expected homography from the reference to the deformed image; the identity if no motion is expected.

    Returns
    -------
    ndarray, shape (n, 6)
        Warps; NaN where the template is too close to the edge, or has no contrast.
    """
    import cv2

    height, width = reference.shape
    moved_back = deformed
    if not np.allclose(motion, np.eye(3), atol=1e-12):
        moved_back = cv2.warpPerspective(
            deformed, motion, (width, height), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        )
    found = np.full((len(points), 2), np.nan)

    def work(band: slice) -> None:
        for k in range(len(points))[band]:
            x, y = points[k].tolist()
            found[k] = _whole_pixel(reference, moved_back, x, y, half_px, radius_px)

    in_parallel(work, bands_of(len(points), _TEMPLATES_PER_TASK), threads)
    shift = found - points
    # The template at a point p looks like the moved-back image at p + shift, which shows motion(p + shift).
    warps = homography_warps(motion, found)
    warps[:, 0] += shift[:, 0]
    warps[:, 3] += shift[:, 1]
    return warps


def _whole_pixel(
    reference: Grey, moved_back: Grey, x: int, y: int, half_px: int, radius_px: int
) -> tuple[float, float]:
    """Return the pixel (x, y) that fits the template around a point best, or NaN without a template."""
    import cv2

    height, width = reference.shape
    half = min(half_px, x, y, width - 1 - x, height - 1 - y)
    left, top = max(0, x - half - radius_px), max(0, y - half - radius_px)
    window = moved_back[top : y + half + radius_px + 1, left : x + half + radius_px + 1]
    template = reference[y - half : y + half + 1, x - half : x + half + 1]
    if half < _SMALLEST_TEMPLATE_RADIUS_PX or np.ptp(template) == 0.0 or np.ptp(window) == 0.0:
        return np.nan, np.nan
    scores = cv2.matchTemplate(window, template, cv2.TM_CCOEFF_NORMED)
    _, _, _, (column, row) = cv2.minMaxLoc(scores)
    return left + column + half, top + row + half
