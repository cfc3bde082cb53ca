"""Grey levels between pixels, grey level profiles across grid lines, and tests whether a line is present.

A segment is the part of a line between two neighbouring intersections. Stations are places on a segment.
"""

import numpy as np
from numpy.typing import NDArray

from dic.targets.lattice import LatticeShape
from dic.typing import Float, Grey

PROFILE_OFFSETS = np.linspace(-0.45, 0.45, 37)


class GridImage:
    """An image that can be sampled between pixels. If the lines are dark, the image is negated.

    The image is interpolated with cubic B-splines in floating point. OpenCV's `remap` is not used, because it
    rounds coordinates to 1/32 px, which is too coarse here.
    """

    def __init__(self, grey: Grey, dark_lines: bool) -> None:
        from scipy.ndimage import spline_filter

        self._grey, self._sign = grey, -1 if dark_lines else 1
        self._coefficients = spline_filter(self._sign * grey, order=3, output=np.float32, mode="mirror")

    def sample(self, points_px: Float) -> Float:
        """Return the grey levels at points (…, 2), each given as (x, y); NaN outside the image."""
        from scipy.ndimage import map_coordinates

        x, y = points_px[..., 0], points_px[..., 1]
        values = map_coordinates(
            self._coefficients,
            [y.ravel(), x.ravel()],
            output=np.float64,
            order=3,
            mode="mirror",
            prefilter=False,
        ).reshape(x.shape)
        height, width = self._grey.shape
        values[(x < 0) | (y < 0) | (x > width - 1) | (y > height - 1)] = np.nan
        return values

    def window(self, low_px: Float, high_px: Float) -> tuple[tuple[int, int], Grey]:
        """Return the pixels between two corners (x, y), and x and y of the first pixel."""
        (left, top), (right, bottom) = (
            np.maximum(np.ceil(low_px), 0).astype(int),
            np.floor(high_px).astype(int),
        )
        pixels: Grey = self._sign * self._grey[top : max(top, bottom + 1), left : max(left, right + 1)]
        return (int(left), int(top)), pixels


def as_bytes(grey: Grey) -> NDArray[np.uint8]:
    """Return the image with grey levels stretched to 0 … 255, for detectors that need 8-bit images."""
    low, high = (float(value) for value in np.percentile(grey, (0.1, 99.9)))
    stretched = np.rint((grey - low) * (255.0 / max(high - low, 1e-6)))
    return np.asarray(np.clip(stretched, 0, 255), np.uint8)


def profiles_across(image: GridImage, shape: LatticeShape, axis: int, numbers: range, across: range) -> Float:
    """Return grey level profiles across the predicted lines, at three places ("stations") of every segment.

    `image`, `shape`: the image, and the map that predicts the positions of the lattice points in the image.
    `axis`: direction of the lines: 0 for lines of constant first index, 1 for lines of constant second index.
    `numbers`: indices of the lines. `across`: indices of the lines of the other direction, which divide the
    lines into segments.

    Result, shape (lines, segments, 3, 37): grey levels of the profiles, in which lines are bright; NaN
    outside the image. The three measuring places ("stations") are at 0.38, 0.5 and 0.62 of the length of a
    segment. The distances of the 37 samples from the line are `PROFILE_OFFSETS`, in pitches.
    """
    index = station_index(axis, numbers, across, np.array([0.38, 0.5, 0.62]))
    step = shape.step(index, axis)
    return image.sample(shape.map(index)[..., None, :] + PROFILE_OFFSETS[:, None] * step[..., None, :])


def line_evidence(profiles: Float) -> Float:
    """Return the contrast of the line in each segment, in grey levels, shape (lines, segments).

    The contrast of a profile is the grey level in its middle minus the grey level of its brighter side. The
    edge of a bright region therefore has no contrast, because one side is as bright as the middle. The result
    is the median of the three measuring places of a segment, so that dirt or a speckle at one place is not
    mistaken for a line.
    """
    middle = profiles[..., np.abs(PROFILE_OFFSETS) < 0.2]
    core = np.lib.stride_tricks.sliding_window_view(middle, 3, axis=-1).mean(axis=-1).max(axis=-1)
    before, after = PROFILE_OFFSETS < -0.3, PROFILE_OFFSETS > 0.3
    sides = np.maximum(profiles[..., before].mean(axis=-1), profiles[..., after].mean(axis=-1))
    evidence: Float = np.nan_to_num(np.median(core - sides, axis=-1), nan=0.0)
    return evidence


def line_irregularity(profiles: Float) -> float:
    """Return how much profiles (n, 3, 37) change along their segments, relative to the profiles' height.

    A true line has the same profile at all three measuring places of a segment. A checkerboard shows false
    lines along the diagonals of its squares. The width of such a false line shrinks to zero in the middle of
    each segment.
    """
    whole = profiles[np.isfinite(profiles).all(axis=(1, 2))]
    if not len(whole):
        return float("inf")
    usual = np.median(whole - whole.min(axis=-1, keepdims=True), axis=0)
    change = usual[1] - (usual[0] + usual[2]) / 2
    return float(np.sqrt(np.mean(change**2)) / max(float(np.ptp(usual)), 1e-9))


def station_index(axis: int, numbers: range, across: range, fractions: Float) -> Float:
    """Return the lattice indices of all measuring places, shape (lines, segments, stations, 2).

    `fractions` are the positions of the measuring places along each segment, from 0 to 1.
    """
    along = np.array(across[:-1])[:, None] + fractions
    lines = np.broadcast_to(np.array(numbers, float)[:, None, None], (len(numbers), *along.shape))
    pair = (lines, np.broadcast_to(along, lines.shape))
    return np.stack(pair if axis == 0 else pair[::-1], axis=-1)
