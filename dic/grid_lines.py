"""Where the lines of a grid are in an image: grey levels between pixels, and evidence that a line is there."""

import numpy as np
from numpy.typing import NDArray

from dic.grid_shape import LatticeShape

Floats = NDArray[np.float64]


class GridImage:
    """An image to sample between pixels, signed so that lines are bright.

    Cubic B-spline interpolation in floating point: OpenCV's remap rounds coordinates to 1/32 px,
    which is more than the accuracy sought.
    """

    def __init__(self, grey: NDArray[np.float32], dark_lines: bool) -> None:
        from scipy.ndimage import spline_filter

        self._coefficients = spline_filter(
            -grey if dark_lines else grey, order=3, output=np.float32, mode="mirror"
        )
        self._shape = grey.shape

    def sample(self, points_px: Floats) -> Floats:
        """Return grey levels at points (…, 2) as (x, y); NaN outside the image."""
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
        height, width = self._shape
        values[(x < 0) | (y < 0) | (x > width - 1) | (y > height - 1)] = np.nan
        return values


def line_evidence(image: GridImage, shape: LatticeShape, axis: int, numbers: range, across: range) -> Floats:
    """Return how much each segment looks like a line, in grey levels, shape (len(numbers), len(across) − 1).

    Parameters
    ----------
    image, shape
        The image and where the lattice lies in it.
    axis : int
        0 for the lines of constant first index, 1 for those of constant second index.
    numbers : range
        Indices of the lines to look for.
    across : range
        Indices of the lines of the other direction, which bound the segments.

    Notes
    -----
    A line is brighter in the middle than on *both* sides; the edge of a region is not. The median over three
    stations counts, so that dirt and speckle do not pass for a line.
    """
    index = station_index(axis, numbers, across, np.array([0.35, 0.5, 0.65]))
    step = shape.step(index, axis)
    offsets = np.linspace(-0.45, 0.45, 37)
    profile = image.sample(shape.map(index)[..., None, :] + offsets[:, None] * step[..., None, :])
    middle = profile[..., np.abs(offsets) < 0.2]
    core = np.lib.stride_tricks.sliding_window_view(middle, 3, axis=-1).mean(axis=-1).max(axis=-1)
    sides = np.stack([profile[..., offsets < -0.3].mean(axis=-1), profile[..., offsets > 0.3].mean(axis=-1)])
    evidence: Floats = np.median(core - sides.max(axis=0), axis=-1)
    return np.nan_to_num(evidence, nan=0.0)


def station_index(axis: int, numbers: range, across: range, fractions: Floats) -> Floats:
    """Return lattice indices (lines, segments, stations, 2) of stations at `fractions` of each segment."""
    along = np.array(across[:-1])[:, None] + fractions
    lines = np.broadcast_to(np.array(numbers, float)[:, None, None], (len(numbers), *along.shape))
    pair = (lines, np.broadcast_to(along, lines.shape))
    return np.stack(pair if axis == 0 else pair[::-1], axis=-1)
