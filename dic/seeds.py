"""The first guess: where a few subsets of the reference are in the deformed image, whatever moved.

Two ways, both without knowledge of the result. `search` compares templates at whole pixels after the deformed
image was turned back by an expected motion (none, or the stage's angle). `feature_motion` finds an arbitrary
plane motion, up to a full turn and a change of scale, from SIFT features (D. Lowe, IJCV 60 (2004) 91-110)
and a robust homography. Both give warps for IC-GN, which alone decides whether a guess was right.
"""

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]
Grey = NDArray[np.float32]

SEARCH_RADII_PX = (24, 80, 200)
"""Search radii, tried in this order until enough seeds converge."""

_FEATURES = 4000
_RATIO = 0.8
_MIN_MATCHES = 12


def homography_warps(homography: Float, points: Float) -> Float:
    """Return the affine warps (n, 6) that a plane motion gives at `points` (n, 2).

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
    reference: Grey, deformed: Grey, points: NDArray[np.int64], half_px: int, radius_px: int, motion: Float
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
        How far the truth may be from `motion`.
    motion : ndarray, shape (3, 3)
        Expected homography from the reference to the deformed image; the identity if nothing is known.

    Returns
    -------
    ndarray, shape (n, 6)
        Warps; NaN where the template does not fit into the image.
    """
    import cv2

    height, width = reference.shape
    turned_back = deformed
    if not np.allclose(motion, np.eye(3), atol=1e-12):
        turned_back = cv2.warpPerspective(
            deformed, motion, (width, height), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        )
    found = np.full((len(points), 2), np.nan)
    for k, (x, y) in enumerate(points):
        half = min(half_px, x, y, width - 1 - x, height - 1 - y)
        left, top = max(0, x - half - radius_px), max(0, y - half - radius_px)
        window = turned_back[top : y + half + radius_px + 1, left : x + half + radius_px + 1]
        template = reference[y - half : y + half + 1, x - half : x + half + 1]
        if half < 3 or template.std() == 0.0 or window.std() == 0.0:
            continue
        scores = cv2.matchTemplate(window, template, cv2.TM_CCOEFF_NORMED)
        row, column = np.unravel_index(int(np.argmax(scores)), scores.shape)
        found[k] = left + column + half, top + row + half
    shift = found - points
    # The template at a point p looks like the turned-back image at p + shift, which shows motion(p + shift).
    warps = homography_warps(motion, found)
    warps[:, 0] += shift[:, 0]
    warps[:, 3] += shift[:, 1]
    return warps


def feature_motion(reference: Grey, deformed: Grey, region: NDArray[np.bool_]) -> Float | None:
    """Return the homography from the reference to the deformed image seen by SIFT features, or None.

    Parameters
    ----------
    reference, deformed : ndarray, shape (height, width)
    region : ndarray of bool, shape (height, width)
        Where features of the reference are taken from.
    """
    import cv2

    sift = cv2.SIFT.create(nfeatures=_FEATURES, contrastThreshold=0.02)
    here, here_words = sift.detectAndCompute(_to_8_bit(reference), region.astype(np.uint8))
    there, there_words = sift.detectAndCompute(_to_8_bit(deformed), None)
    if min(len(here), len(there)) < _MIN_MATCHES:
        return None
    pairs = cv2.BFMatcher(cv2.NORM_L2).knnMatch(here_words, there_words, k=2)
    good = [m[0] for m in pairs if len(m) == 2 and m[0].distance < _RATIO * m[1].distance]
    if len(good) < _MIN_MATCHES:
        return None
    source = np.array([here[m.queryIdx].pt for m in good])
    target = np.array([there[m.trainIdx].pt for m in good])
    motion, inliers = cv2.findHomography(
        source, target, cv2.USAC_MAGSAC, 3.0, maxIters=5000, confidence=0.999
    )
    if motion is None or int(np.count_nonzero(inliers)) < _MIN_MATCHES:
        return None
    return np.asarray(motion, np.float64)


def _to_8_bit(grey: Grey) -> NDArray[np.uint8]:
    """Return the image stretched to 0..255 between its 0.5 and 99.5 percentiles, as SIFT wants it."""
    low, high = np.percentile(grey, (0.5, 99.5))
    stretched = np.clip((grey - low) * (255.0 / max(float(high - low), 1e-9)), 0, 255)
    return np.asarray(stretched, np.uint8)
