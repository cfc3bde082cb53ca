"""The intersection of a curve, given by points, with a straight line through the origin."""

from dataclasses import dataclass

import numpy as np

from dic.typing import Float

_NEAR = 3
"""Number of points on each side of the intersection through which the smooth curve is drawn."""


@dataclass(frozen=True)
class Crossing:
    """The intersection of a curve with a line."""

    stress_mpa: float
    point: int
    """First point beyond the line."""
    std_mpa: float
    """Standard deviation of the stress. It is not zero because the curve between its points is not known."""


def crossing(strain: Float, stress: Float, slope: float, first: int) -> Crossing | None:
    """Return where a curve falls below the line ``stress = slope · strain``; None if it stays above the line.

    The curve is assumed to have a slope that only falls. Between two points such a curve lies above the
    straight line through these points, and below the extended line through the next two points. The first
    bound is exact if the curve is straight; the second is exact for a curve that yields at a sharp corner.
    The returned stress lies on a smooth curve between the bounds. Its standard deviation is computed from a
    rectangular distribution that reaches to the farther bound.

    `strain`, `stress`, shape (n,): points of the curve. The strain is counted from the foot of the line.
    `slope`: MPa. `first`: index of the point at which the search begins.
    """
    above = stress - slope * strain
    # One point below the line may be noise, so three in a row are required.
    for k in first + np.flatnonzero(above[first:] < 0.0):
        if (above[k : k + 3] < 0.0).all() and k > 0:
            return _between(strain, stress, above, slope, int(k))
    return None


def _between(strain: Float, stress: Float, above: Float, slope: float, k: int) -> Crossing:
    """Return the intersection of a curve with the line between the curve's points k - 1 and k."""
    share = above[k - 1] / (above[k - 1] - above[k]) if above[k - 1] > 0.0 else 1.0
    lowest = float(stress[k - 1] + share * (stress[k] - stress[k - 1]))
    highest = max(_extended(strain, stress, slope, k), lowest)
    value = min(max(_smooth(stress, above, k, lowest), lowest), highest)
    return Crossing(value, k, max(highest - value, value - lowest) / float(np.sqrt(3.0)))


def _extended(strain: Float, stress: Float, slope: float, k: int) -> float:
    """Return the stress where the line through the points k and k + 1, extended backwards, meets the line."""
    near = stress[k - 1 : k + 2]
    if len(near) < 3 or strain[k + 1] <= strain[k]:
        return float(near.max())
    rise = float((stress[k + 1] - stress[k]) / (strain[k + 1] - strain[k]))
    if rise >= slope:
        return float(near.max())
    strain_there = (stress[k] - rise * strain[k]) / (slope - rise)
    return min(float(slope * strain_there), float(near.max()))


def _smooth(stress: Float, above: Float, k: int, straight: float) -> float:
    """Return the stress where a smooth curve through the points around point k meets the line.

    The curve is piecewise cubic and keeps the rise of the points (F. N. Fritsch and R. E. Carlson, SIAM J.
    Numer. Anal. 17, 238, 1980). Points are left out if noise keeps the distance from the line from changing
    steadily.
    """
    first, stop = k - 1, k + 1
    while first > max(k - _NEAR, 0) and above[first - 1] > above[first]:
        first -= 1
    while stop < min(k + _NEAR, len(above)) and above[stop] < above[stop - 1]:
        stop += 1
    if stop - first < 3 or above[k - 1] <= 0.0:
        return straight
    from scipy.interpolate import PchipInterpolator

    return float(PchipInterpolator(-above[first:stop], stress[first:stop])(0.0))
