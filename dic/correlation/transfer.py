"""Transfer functions: how interpolation, derivatives and smoothing change the waves of an image."""

import numpy as np

from dic.image.spline import slope_taps
from dic.typing import Float

COPIES = 6
"""Number of shifted copies (replicas) of the spectrum, on either side, that are taken into account."""


def interpolation_transfer(frequency: Float, order: int) -> Float:
    """Return the Fourier transform of the interpolating B-spline of degree `order` at angular frequencies.

    The interpolating (cardinal) spline has the transform sincᵐ(ω/2π) / Σ sincᵐ(ω/2π + n), where m is the
    degree plus 1 and the sum is over all integers n (M. Unser, IEEE Signal Processing Magazine 16(6), 1999).
    Perfect interpolation would have the value 1 below π rad/px and 0 above.
    """
    cycles, power = np.asarray(frequency) / (2 * np.pi), order + 1
    replicas = np.arange(-COPIES - 2, COPIES + 3)
    # The sum is periodic; move the frequency to the main period, where few replicas are enough.
    main = cycles - np.rint(cycles)
    total = (np.sinc(main[..., None] + replicas) ** power).sum(axis=-1)
    return np.asarray(np.sinc(cycles) ** power / total)


def slope_transfer(frequency: Float, order: int) -> Float:
    """Return the factor, divided by i, by which the spline's derivative at the pixels multiplies a wave.

    The exact derivative would multiply by the angular frequency.
    """
    taps = slope_taps(order)
    reach = len(taps) // 2
    return np.asarray(np.sin(np.multiply.outer(frequency, np.arange(-reach, reach + 1))) @ taps)


def filter_transfer(frequency: Float, taps: tuple[float, ...]) -> Float:
    """Return the factor by which a symmetric filter with the given taps multiplies a wave."""
    reach = len(taps) // 2
    return np.asarray(
        np.cos(np.multiply.outer(frequency, np.arange(-reach, reach + 1))) @ np.array(taps, np.float64)
    )
