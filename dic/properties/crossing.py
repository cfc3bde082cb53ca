"""The intersection of a curve, given by points, with a straight line through the origin."""

from dataclasses import dataclass

import numpy as np

from dic.typing import Float

_NOISE_TIMES, _REACH_SHARE = 3.0, 0.5
"""Points are near to the line within this number of standard deviations of the noise, and at most within this
share of the greatest distance of the elastic part from the line."""
_LEAST_FITTED, _LEAST_CURVED, _MOST_ROUNDS, _SMOOTHED, _LEAST_FREE = 8, 12, 5, 5, 0.3
_NEAR = 3
"""Number of points on each side of the intersection through which the smooth curve is drawn."""


@dataclass(frozen=True)
class Crossing:
    """The intersection of a curve with a line."""

    stress_mpa: float
    point: int
    """First point beyond the line."""
    std_mpa: float
    """Standard deviation of the stress: the curve between its points is not known, and points are noisy."""


@dataclass(frozen=True)
class Noise:
    """Standard deviations of the noise of a curve's points, which neighbouring points do not share."""

    strain: float
    stress_mpa: float
    shared_mpa: float
    """Part of the noise of the stress that neighbouring points may share, so that it does not average out."""
    alike: float = 0.0
    """Correlation of the noise of neighbouring points."""


def crossing(strain: Float, stress: Float, slope: float, first: int, noise: Noise) -> Crossing | None:
    """Return where a curve falls below the line ``stress = slope · strain``; None if it stays above the line.

    If many points are as near to the line as their noise, the curve is a parabola through these points, and
    the standard deviation comes from their scatter. Otherwise the curve goes through the points.

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
            reach = min(
                _NOISE_TIMES * float(np.hypot(noise.stress_mpa, slope * noise.strain)),
                _most_reach(above, first),
            )
            fitted = _fitted(stress, above, first, int(k), reach, noise)
            return _between(strain, stress, above, slope, int(k), noise) if fitted is None else fitted
    return None


def _most_reach(above: Float, first: int) -> float:
    """Return the greatest distance from the line, MPa, at which points tell the curve at the line."""
    return _REACH_SHARE * float(above[: max(first, 1)].max(initial=0.0))


def _fitted(stress: Float, above: Float, begin: int, k: int, reach: float, noise: Noise) -> Crossing | None:
    """Return the intersection of the line with a parabola through the points near to the line.

    None if there are too few such points, or they do not fall below the line.
    """
    for _ in range(_MOST_ROUNDS):
        first, stop = _near(above, begin, k, reach)
        if stop - first < _LEAST_FITTED:
            return None
        place = np.linspace(-1.0, 1.0, stop - first)
        terms = np.vander(place, 3 if stop - first >= _LEAST_CURVED else 2)
        fits = np.linalg.lstsq(terms, np.column_stack([above[first:stop], stress[first:stop]]), rcond=None)[0]
        roots = np.roots(fits[:, 0])
        real = roots[np.abs(roots.imag) < 1e-9].real
        falling = [float(x) for x in real if abs(x) <= 1.0 and np.polyval(np.polyder(fits[:, 0]), x) < 0.0]
        if not falling:
            return None
        at = min(falling, key=abs)
        found = first + round(0.5 * (at + 1.0) * (stop - first - 1))
        if found == k:
            break
        k = found
    value = float(np.polyval(fits[:, 1], at))
    # An error of `above` moves the intersection along the curve.
    along = float(np.polyval(np.polyder(fits[:, 1]), at) / -np.polyval(np.polyder(fits[:, 0]), at))
    rest = (np.column_stack([above[first:stop], stress[first:stop]]) - terms @ fits) @ [along, 1.0]
    power = np.vander([at], terms.shape[1])[0]
    spread = float(power @ np.linalg.inv(terms.T @ terms) @ power)
    # Points with correlated errors contain less information than independent ones.
    alike = float(np.clip((rest[1:] @ rest[:-1]) / max(float(rest @ rest), 1e-300), noise.alike, 0.98))
    each = (1.0 + alike) / (1.0 - alike)
    free = len(rest) - each * terms.shape[1]
    if free < _LEAST_FREE * len(rest):
        return None
    scatter = float(np.sqrt(rest @ rest / free * spread * each))
    return Crossing(value, max(k, 1), float(np.hypot(scatter, noise.shared_mpa * (1.0 + along))))


def _near(above: Float, begin: int, k: int, reach: float) -> tuple[int, int]:
    """Return the first of the consecutive points around k whose mean distance from the line is within reach.

    The second value is the point after the last one.
    """
    first, stop = k, k + 1
    while first > begin and np.mean(above[first - 1 : first + _SMOOTHED]) <= reach:
        first -= 1
    while stop < len(above) and np.mean(above[max(stop - _SMOOTHED, 0) : stop + 1]) >= -reach:
        stop += 1
    half = max(min(k - first, stop - 1 - k), 1)
    return max(first, k - 2 * half), min(stop, k + 1 + 2 * half)


def _between(strain: Float, stress: Float, above: Float, slope: float, k: int, noise: Noise) -> Crossing:
    """Return the intersection of a curve with the line between the curve's points k - 1 and k."""
    share = above[k - 1] / (above[k - 1] - above[k]) if above[k - 1] > 0.0 else 1.0
    lowest = float(stress[k - 1] + share * (stress[k] - stress[k - 1]))
    highest = max(_extended(strain, stress, slope, k), lowest)
    value = min(max(_smooth(stress, above, k, lowest), lowest), highest)
    unknown = max(highest - value, value - lowest) / float(np.sqrt(3.0))
    rise = (stress[k] - stress[k - 1]) / (above[k - 1] - above[k])
    along = float(np.clip(rise, 0.0, 1.0))
    noisy = np.hypot(noise.stress_mpa * (1.0 + along), along * slope * noise.strain)
    # The stress lies between two points, whose noise partly averages out.
    mean = float(np.sqrt(share**2 + (1.0 - share) ** 2 + 2.0 * noise.alike * share * (1.0 - share)))
    std_mpa = np.linalg.norm([unknown, noisy * mean, noise.shared_mpa * (1.0 + along)])
    return Crossing(value, k, float(std_mpa))


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
