"""How points are correlated, and which pixels belong to one: the values that most of the kernel takes."""

from typing import NamedTuple

Taps = tuple[float, ...]
"""A tuple of 4 or 6 numbers. Only its length matters: numba compiles the code for that many taps."""

Shape = tuple[float, ...]
"""A tuple of 6 or 12 numbers. Only its length matters: numba compiles the code for that many parameters."""


class Method(NamedTuple):
    """How points are correlated: the settings that the kernel needs.

    Attributes
    ----------
    taps : tuple of 4 or 6 numbers
        Its length tells the spline: cubic or quintic.
    shape : tuple of 6 or 12 numbers
        Its length tells the shape function: affine or quadratic.
    radius : int
        Pixels of the subset on either side of its centre.
    min_zncc, tolerance_px, max_iterations
        As in `CorrelationSettings`.
    noise_gain, slope_noise_gain : float
        Factors by which interpolation half-way between pixels, and the derivative at the pixels, change the
        variance of white noise (`dic.image.spline`).
    """

    taps: Taps
    shape: Shape
    radius: int
    min_zncc: float
    tolerance_px: float
    max_iterations: int
    noise_gain: float
    slope_noise_gain: float


class Subset(NamedTuple):
    """A square of pixels around a point of the reference.

    Attributes
    ----------
    x, y : int
        The point, px.
    radius : int
        Pixels on either side of the point.
    pixels : int
        How many of the subset's pixels lie in the region of interest.
    """

    x: int
    y: int
    radius: int
    pixels: int
