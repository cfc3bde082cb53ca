"""First guesses for large motion, from features of the pattern that are recognised after any rotation.

Scale-invariant features (SIFT; D. Lowe, International Journal of Computer Vision 60 (2004) 91-110) of the
reference are matched with features of the deformed image. A match gives the displacement, the rotation and
the scale of a feature. So each match predicts the positions of neighbouring features. The first guess at a
point follows from the prediction that most neighbours confirm. Different parts of the image may move
differently.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dic.image.stored import StoredImage, is_large
from dic.typing import Float, Grey, Indices, Mask

Descriptors = NDArray[np.float32]
"""SIFT descriptors of n features, shape (n, 128)."""

_AREA_PX = 400_000
"""The first search for features uses images that are shrunk to this area, which is usually large enough."""

_LARGEST_AREA_PX = 12_000_000
"""The last search for features uses images of at most this area."""

_FEATURES = 2000
_CONTRAST = 0.02

_RATIO = 0.8
"""Largest ratio of the best match's descriptor distance to the second-best match's (Lowe's ratio test)."""

_FEWEST_MATCHES = 12

_NEIGHBOURS = 24
_FEWEST_SUPPORTERS = 5
_TOLERANCE_PX, _TOLERANCE = 2.0, 0.15
"""Largest allowed error of a predicted position: a number of px, plus a fraction of the distance."""


@dataclass(frozen=True)
class Matches:
    """Features of the reference, and the matching features of the deformed image; some matches are wrong."""

    here: Float
    there: Float
    """Shape (n, 2). Positions (x, y) of the features in the reference and in the deformed image, px."""
    gradient: Float
    """Shape (n, 2, 2). Deformation gradients, computed from the rotations and scales of the features."""

    def warps_at(self, points: Float) -> Float:
        """Return affine warps (n, 6) at `points` (n, 2), fitted to nearby matches.

        A warp is NaN if too few matches agree.
        """
        from scipy.spatial import cKDTree

        count = min(_NEIGHBOURS, len(self.here))
        _, near = cKDTree(self.here).query(points, count)
        nearest = np.asarray(near).reshape(len(points), count)
        warps = [self._local_warp(at, k) for at, k in zip(points, nearest, strict=True)]
        return np.array(warps).reshape(-1, 6)

    def _local_warp(self, point: Float, near: Indices) -> Float:
        """Fit a warp at a point to the neighbouring matches that agree with the best of these matches."""
        here, there = self.here[near], self.there[near]
        offset = here[None, :, :] - here[:, None, :]
        predicted = there[:, None, :] + np.einsum("iab,ijb->ija", self.gradient[near], offset)
        allowed = _TOLERANCE_PX + _TOLERANCE * np.linalg.norm(offset, axis=2)
        confirmed = np.linalg.norm(there[None, :, :] - predicted, axis=2) < allowed
        supporters = confirmed[np.argmax(confirmed.sum(axis=1))]
        if supporters.sum() < _FEWEST_SUPPORTERS:
            return np.full(6, np.nan)
        design = np.column_stack([np.ones(supporters.sum()), here[supporters] - point])
        (place, *gradient), _, rank, _ = np.linalg.lstsq(design, there[supporters], rcond=None)
        if rank < 3:
            return np.full(6, np.nan)
        F = np.array(gradient).T - np.eye(2)
        u, v = place - point
        return np.array([u, F[0, 0], F[0, 1], v, F[1, 0], F[1, 1]])


class FeatureFinder:
    """Find the features of one reference in deformed images.

    `usable`, shape (height, width): True at pixels where features of the reference may lie.
    """

    def __init__(self, reference: StoredImage, usable: Mask) -> None:
        self._reference, self._usable = reference, None if usable.all() else usable
        self._known: dict[float, tuple[Float, Descriptors]] = {}

    def find(self, deformed: StoredImage) -> Iterator[Matches]:
        """Yield the matches of shrunk images first, then those of larger images.

        The last images have the full size, but at most 12 megapixels, because the search takes more than a
        hundred bytes for each pixel.
        """
        size = deformed.shape[0] * deformed.shape[1]
        shrink, least = (max(1.0, float(np.sqrt(size / area))) for area in (_AREA_PX, _LARGEST_AREA_PX))
        while True:
            if shrink not in self._known:
                self._known[shrink] = _features(self._reference, shrink, self._usable)
            matches = _match(self._known[shrink], _features(deformed, shrink))
            if matches is not None:
                yield matches
            if shrink == least:
                return
            shrink = max(least, shrink / 2)


def _features(image: StoredImage, shrink: float, usable: Mask | None = None) -> tuple[Float, Descriptors]:
    """Return the x, y, size and angle (radians) of features, shape (n, 4), and the SIFT descriptors."""
    import cv2

    height, width = image.shape
    size = (round(width / shrink), round(height / shrink))
    mask = None if usable is None else usable.view(np.uint8)
    if is_large(image.shape):
        small = _to_8_bit(image.reduced(size))
    else:
        small = _to_8_bit(image.rows(0, height))
        if shrink > 1.0:
            small = np.asarray(cv2.resize(small, size, interpolation=cv2.INTER_AREA), np.uint8)
    if mask is not None and mask.shape != small.shape:
        mask = cv2.resize(mask, size, interpolation=cv2.INTER_NEAREST)
    sift = cv2.SIFT.create(nfeatures=_FEATURES, contrastThreshold=_CONTRAST)
    found, descriptors = sift.detectAndCompute(small, mask)
    if descriptors is None:
        return np.empty((0, 4)), np.empty((0, 128), np.float32)
    places = np.array([(*k.pt, k.size, np.radians(k.angle)) for k in found], np.float64)
    scale = np.array((width, height)) / small.shape[::-1]
    places[:, :2] = (places[:, :2] + 0.5) * scale - 0.5
    return places, descriptors


def _match(here: tuple[Float, Descriptors], there: tuple[Float, Descriptors]) -> Matches | None:
    """Return the pairs of features that pass Lowe's ratio test, or None if there are too few pairs."""
    import cv2

    if min(len(here[0]), len(there[0])) < _FEWEST_MATCHES:
        return None
    pairs = cv2.BFMatcher(cv2.NORM_L2).knnMatch(here[1], there[1], k=2)
    good = [(a.queryIdx, a.trainIdx) for a, b in pairs if a.distance < _RATIO * b.distance]
    if len(good) < _FEWEST_MATCHES:
        return None
    one, other = np.array(good).T
    before, after = here[0][one], there[0][other]
    scale, angle = after[:, 2] / before[:, 2], after[:, 3] - before[:, 3]
    c, s = scale * np.cos(angle), scale * np.sin(angle)
    gradient = np.stack([np.stack([c, -s], axis=-1), np.stack([s, c], axis=-1)], axis=1)
    return Matches(before[:, :2], after[:, :2], gradient)


def _to_8_bit(grey: Grey) -> NDArray[np.uint8]:
    """Return the image for SIFT, stretched so that its 0.5 and 99.5 percentiles become 0 and 255."""
    low, high = np.percentile(grey[:: max(1, len(grey) // 1000)], (0.5, 99.5))
    stretched = np.clip((grey - low) * (255.0 / max(float(high - low), 1e-9)), 0, 255)
    return np.asarray(stretched, np.uint8)
