"""Arguments of most functions of the kernel: the settings, and the subset of a point."""

from typing import NamedTuple

NOT_LAID = -1
"""Status of a point whose first guess is too close to the end of the rows that are laid."""

ROOM_PX = 32
"""Number of rows that must be laid on either side of the first guess.

In an image that is laid in bands, a point that moves farther during its iterations has not converged.
"""

Taps = tuple[float, ...]
"""A tuple that is used only for its length: 4 for a cubic spline, 6 for a quintic spline.

The length is the number of spline coefficients (taps) along x, and also along y, that an interpolation needs.
The numbers in the tuple are not used. Numba compiles separate code for each length.
"""

Shape = tuple[float, ...]
"""A tuple that is used only for its length, the number of warp parameters: 6 or 12.

The numbers in the tuple are not used. Numba compiles separate code for each length.
"""


class Method(NamedTuple):
    """The settings of the correlation that the kernel needs."""

    taps: Taps
    """The length of the tuple is 4 for a cubic spline and 6 for a quintic spline."""
    shape: Shape
    """The length of the tuple is 6 for affine and 12 for quadratic shape functions."""
    radius: int
    """Half of the subset's width in px, without the pixel at the centre: the width is 2 radius + 1 px."""
    min_zncc: float
    tolerance_px: float
    max_iterations: int
    """The settings of the same names in `CorrelationSettings`."""
    noise_gain: float
    slope_noise_gain: float
    """Variance of a grey level that is interpolated half-way between two pixels, and variance of the
    derivative at a pixel, if the pixels have white noise of variance 1 (`dic.image.spline`).
    """


class Subset(NamedTuple):
    """A subset, which is a square of pixels around a point of the reference."""

    x: int
    y: int
    """Coordinates of the point, px."""
    radius: int
    """Number of pixels on either side of the point."""
    pixels: int
    """Number of the subset's pixels in the region of interest."""
