"""First guesses of the displacements of a few subsets.

`guesses` yields the most likely and cheapest guesses first. `search` compares templates at whole pixels. If a
motion is expected, such as a shift of the whole image or the rotation of a stage, `search` first moves the
deformed image back by this motion. For large rotations and displacements, guesses follow from features
(`dic.correlation.features`). Every guess is a warp. The IC-GN iteration then decides whether the guess is
right.
"""

from collections.abc import Iterator

import numpy as np

from dic.correlation.features import FeatureFinder
from dic.errors import CorrelationError
from dic.image.stored import StoredImage, is_large
from dic.image.threads import bands_of, in_parallel
from dic.typing import Float, Grey, Indices

SEARCH_RADII_PX = (24, 80, 200)
"""Search radii, which are tried in this order until enough seed points converge."""

_TEMPLATES_PER_TASK = 4
"""Number of templates that a thread searches in one call."""

_SMALLEST_TEMPLATE_RADIUS_PX = 3

_SHIFT_SIDE_PX = 512
"""Images are shrunk to this width or height before the shift of the whole image is measured."""


def guesses(
    reference: StoredImage,
    deformed: StoredImage,
    features: FeatureFinder,
    points: Indices,
    half_px: int,
    *,
    previous: Float | None = None,
    hint: Float | None = None,
    near_px: int | None = None,
    threads: int = 1,
) -> Iterator[tuple[str, Float]]:
    """Yield first guesses one by one; each has a name and the warps (n, 6) at `points` (n, 2).

    The most likely and cheapest guesses come first.

    `features`: the feature finder of the reference. `points`, shape (n, 2): coordinates (x, y) of the points
    in the reference. `half_px`: half of the template width. The width is 2 * half_px + 1 pixels. `previous`,
    shape (n, 6): the warps of the points in an earlier image. A warp is NaN if the point failed there.
    `hint`, shape (3, 3): expected homography from the reference to the deformed image. `near_px`: half of the
    period of a pattern that repeats. Within this distance of the expected motion all points choose the same
    period.
    """

    def found_around(motion: Float, radius_px: int) -> Float:
        return search(reference, deformed, points, half_px, radius_px, motion, threads)

    small, middle, large = SEARCH_RADII_PX
    known_before = previous is not None and np.isfinite(previous).any()
    if near_px is not None and (hint is not None or not known_before):
        yield "search" if hint is None else "hint", found_around(np.eye(3) if hint is None else hint, near_px)
    if hint is not None:
        for radius in SEARCH_RADII_PX:
            yield "hint", found_around(hint, radius)
    if previous is not None and known_before:
        yield "previous", previous
        # The specimen may have moved far since the earlier image.
        yield "search", found_around(mean_motion(previous, points), small)
    yield "search", found_around(np.eye(3), small)
    shift = whole_shift(reference, deformed)
    if np.hypot(shift[0, 2], shift[1, 2]) > small / 2:
        yield "search", found_around(shift, small)
    yield "search", found_around(np.eye(3), middle)
    for matches in features.find(deformed):
        yield "features", matches.warps_at(points.astype(np.float64))
    yield "search", found_around(np.eye(3), large)


def whole_shift(reference: StoredImage, deformed: StoredImage) -> Float:
    """Return the shift of the whole image as a homography (3, 3), in whole pixels, by phase correlation.

    C. Kuglin, D. Hines, "The phase correlation image alignment method", IEEE Conference on Cybernetics and
    Society (1975) 163-165.
    """
    import cv2

    height, width = reference.shape
    shrink = max(1.0, max(height, width) / _SHIFT_SIDE_PX)
    size = (round(width / shrink), round(height / shrink))
    here, there = reference.reduced(size), deformed.reduced(size)
    # Without a window function, the fixed edges of the image would dominate the measured shift.
    (x, y), _ = cv2.phaseCorrelate(here, there, cv2.createHanningWindow(size, cv2.CV_32F))
    return np.array(
        [[1.0, 0.0, round(x * width / size[0])], [0.0, 1.0, round(y * height / size[1])], [0, 0, 1]]
    )


def mean_motion(warps: Float, points: Indices) -> Float:
    """Return the homography (3, 3) with the mean displacement and gradient of warps (n, 6) at `points`.

    Warps with NaN are left out.
    """
    known = np.isfinite(warps).all(axis=1)
    u, u_x, u_y, v, v_x, v_y = warps[known].mean(axis=0)
    x, y = points[known].mean(axis=0)
    first, second = [1 + u_x, u_y, u - u_x * x - u_y * y], [v_x, 1 + v_y, v - v_x * x - v_y * y]
    return np.array([first, second, [0.0, 0.0, 1.0]])


def rigid_motion(angle_deg: float, shift_px: tuple[float, float], centre_px: tuple[float, float]) -> Float:
    """Return the homography (3, 3) of a rotation about a centre, followed by a shift.

    Parameters
    ----------
    angle_deg : float
        Rotation angle, positive counter-clockwise as seen in the image.
    shift_px : (float, float)
        Shift to the right and downwards.
    centre_px : (float, float)
        Column and row of the centre of rotation.
    """
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    rotation = np.array([[c, s], [-s, c]])
    centre = np.array(centre_px)
    motion = np.eye(3)
    motion[:2, :2], motion[:2, 2] = rotation, centre + np.array(shift_px) - rotation @ centre
    return motion


def checked_homography(hint: object) -> Float:
    """Return the homography of an expected motion as an array (3, 3).

    Raises `CorrelationError` if `hint` is not a 3 x 3 array of finite numbers, or if its last element is 0.
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
        "give the homography that dic.correlation.rigid_motion returns",
    )


def homography_warps(homography: Float, points: Float) -> Float:
    """Return the affine warps (n, 6) of a homography at `points` (n, 2).

    `homography`, shape (3, 3): the matrix that maps pixel coordinates (x, y, 1) of the reference to the
    deformed image.
    """
    x, y = points[:, 0], points[:, 1]
    (a, b, c), (d, e, f), (g, h, k) = homography
    w = g * x + h * y + k
    X, Y = (a * x + b * y + c) / w, (d * x + e * y + f) / w
    columns = [X - x, (a - g * X) / w - 1, (b - h * X) / w, Y - y, (d - g * Y) / w, (e - h * Y) / w - 1]
    return np.stack(columns, axis=1)


def search(
    reference: StoredImage,
    deformed: StoredImage,
    points: Indices,
    half_px: int,
    radius_px: int,
    motion: Float,
    threads: int = 1,
) -> Float:
    """Find subsets by normalised cross-correlation at whole pixels around their expected positions.

    `points`, shape (n, 2): centres (x, y) of the templates in the reference. `half_px`: half of the template
    width. The width is 2 * half_px + 1 pixels. `radius_px`: largest difference between a displacement and the
    displacement that `motion` predicts. `motion`, shape (3, 3): expected homography from the reference to the
    deformed image. If no motion is expected, give the identity matrix.

    Result, shape (n, 6): the warps of the points. A warp is NaN if the template is too close to the image's
    edge or has no contrast.
    """
    moved_back = _MovedBack(deformed, motion)
    found = np.full((len(points), 2), np.nan)

    def work(band: slice) -> None:
        for k in range(len(points))[band]:
            x, y = points[k].tolist()
            found[k] = _whole_pixel(reference, moved_back, x, y, half_px, radius_px)

    in_parallel(work, bands_of(len(points), _TEMPLATES_PER_TASK), threads)
    shift = found - points
    # The template of the point p was found at p + shift in the image that was moved back. In the deformed
    # image, this place is motion(p + shift).
    warps = homography_warps(motion, found)
    warps[:, 0] += shift[:, 0]
    warps[:, 3] += shift[:, 1]
    return warps


class _MovedBack:
    """The deformed image after an expected motion is undone; of a large image, the parts that are used."""

    def __init__(self, deformed: StoredImage, motion: Float) -> None:
        self._deformed, self._motion = deformed, motion
        self._still = np.allclose(motion, np.eye(3), atol=1e-12)
        self._whole: Grey | None = None
        if not self._still and not is_large(deformed.shape):
            height, width = deformed.shape
            self._whole = _warped(deformed.rows(0, height), motion, (width, height))

    def part(self, rows: slice, columns: slice) -> Grey:
        """Return the grey levels of some rows and columns."""
        if self._whole is not None:
            return self._whole[rows, columns]
        if self._still:
            return self._deformed.part(rows, columns)
        x, y = np.array([columns.start, columns.stop]), np.array([rows.start, rows.stop])
        corners = np.stack([np.repeat(x, 2), np.tile(y, 2), np.ones(4)])
        there = self._motion @ corners
        there = there[:2] / there[2]
        height, width = self._deformed.shape
        first = np.clip(np.floor(there.min(axis=1)).astype(int) - 1, 0, (width - 1, height - 1))
        last = np.clip(np.ceil(there.max(axis=1)).astype(int) + 2, first + 1, (width, height))
        shown = self._deformed.part(slice(first[1], last[1]), slice(first[0], last[0]))
        motion = _shift(-first) @ self._motion @ _shift(corners[:2].min(axis=1))
        return _warped(shown, motion, (columns.stop - columns.start, rows.stop - rows.start))


def _warped(image: Grey, motion: Float, size: tuple[int, int]) -> Grey:
    """Return the image of `size` (width, height) whose pixels `motion` maps to pixels of `image`."""
    import cv2

    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(cv2.warpPerspective(image, motion, size, flags=flags), np.float32)


def _shift(by: Float | Indices) -> Float:
    """Return the homography (3, 3) of a shift by (x, y)."""
    homography = np.eye(3)
    homography[:2, 2] = by
    return homography


def _whole_pixel(
    reference: StoredImage, moved_back: _MovedBack, x: int, y: int, half_px: int, radius_px: int
) -> tuple[float, float]:
    """Return the pixel (x, y) where the image matches a point's template best; NaN if no template fits."""
    import cv2

    height, width = reference.shape
    half = min(half_px, x, y, width - 1 - x, height - 1 - y)
    left, top = max(0, x - half - radius_px), max(0, y - half - radius_px)
    if half < _SMALLEST_TEMPLATE_RADIUS_PX:
        return np.nan, np.nan
    bottom, right = min(height, y + half + radius_px + 1), min(width, x + half + radius_px + 1)
    window = moved_back.part(slice(top, bottom), slice(left, right))
    template = reference.part(slice(y - half, y + half + 1), slice(x - half, x + half + 1))
    if np.ptp(template) == 0.0 or np.ptp(window) == 0.0:
        return np.nan, np.nan
    scores = cv2.matchTemplate(window, template, cv2.TM_CCOEFF_NORMED)
    _, _, _, (column, row) = cv2.minMaxLoc(scores)
    return left + column + half, top + row + half
