"""The marks of a plate of dots: three hollow dots, at the origin, on the X axis and on the Y axis.

DICe and VIC use plates with such marks. The lattice of dots may be larger than the picture, because the marks
alone give the origin and the axes.
"""

from dataclasses import dataclass

import numpy as np

from dic.targets.axes import Axes, axes_towards
from dic.targets.blobs import Blobs
from dic.typing import Float, Grey, Indices, Mask

# Smallest brightness of the middle of a hollow dot, as a fraction of the contrast between dot and background.
_HOLLOW = 0.3
# Radii at which the rim and the surroundings of a dot are sampled, as multiples of the ellipse's semi-axes.
_RIM = (0.5, 0.6, 0.7, 0.8)
_BESIDE = 1.5
_SPOKES = 16


@dataclass(frozen=True)
class HollowMarks:
    """Three hollow dots that were found."""

    origin: Indices
    """Shape (2,). Lattice index of the origin mark."""
    axes: Axes
    """Directions of X and Y: from the origin mark to the two other marks."""
    pitches: tuple[int, int]
    """Distances, in pitches, from the origin mark to the mark on X and to the mark on Y."""


def hollow_dots(grey: Grey, blobs: Blobs) -> Mask:
    """Return True for each blob (n,) that is a ring: its middle has nearly the background's grey level."""
    middle = _mean_level(grey, blobs, (0.0, 0.12))
    rim = np.stack([_mean_level(grey, blobs, (radius,)) for radius in _RIM])
    beside = _mean_level(grey, blobs, (_BESIDE,))
    sign = -1.0 if blobs.dark else 1.0
    most = (sign * rim).max(axis=0)
    contrast = np.maximum(most - sign * beside, 1e-6)
    return np.asarray((most - sign * middle) / contrast > _HOLLOW)


def find_hollow_marks(index: Indices, hollow: Mask, vectors: Float) -> HollowMarks | None:
    """Return the marks among the dots of a lattice.

    The marks form a right angle, and its sides are parallel to the lattice vectors. Seen from the front, Y is
    90° anticlockwise from X. This rule decides which of the two outer marks lies on X.

    `index`, shape (n, 2): lattice indices of the dots. `vectors`, shape (2, 2): the two lattice vectors in
    the image, px. `hollow` has the shape (n,).

    The result is None unless exactly three dots are hollow and form such an angle.
    """
    marks = index[hollow]
    if len(marks) != 3:
        return None
    for origin in range(3):
        first, second = (marks[k] - marks[origin] for k in range(3) if k != origin)
        if (first == 0).sum() == 1 and (second == 0).sum() == 1 and first @ second == 0:
            towards = first + second
            axes = axes_towards((int(np.sign(towards[0])), int(np.sign(towards[1]))), vectors, "mark")
            along_x, along_y = (int(abs(towards[axis])) for axis in axes.lattice_axes)
            return HollowMarks(marks[origin], axes, (along_x, along_y))
    return None


def _mean_level(grey: Grey, blobs: Blobs, radii: tuple[float, ...]) -> Float:
    """Return mean grey levels (n,) on the blobs' ellipses, scaled by each of the radii."""
    import cv2

    angle = np.arange(_SPOKES) * (2 * np.pi / _SPOKES)
    circle = np.concatenate([radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1) for radius in radii])
    # The columns of this factor map the unit circle to the ellipse.
    factor = 2 * np.linalg.cholesky(blobs.covariance_px2)
    places = (blobs.centre_px[:, None] + circle @ np.swapaxes(factor, 1, 2)).astype(np.float32)
    # OpenCV's `remap` rounds positions to 1/32 px. This is accurate enough to decide whether there is a hole.
    level = cv2.remap(grey, places[..., 0], places[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    mean: Float = np.asarray(level, np.float64).mean(axis=1)
    return mean
