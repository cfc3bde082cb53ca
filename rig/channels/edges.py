"""Edges of a signal, and of the brightness of a camera's images, that switches between two levels."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig.samples import Floats

LEAST_CONTRAST = 6.0
"""A value switches if its two levels are farther apart than this multiple of the scatter about them.

Noise and mains hum alone reach 3 and 5.
"""
_LEAVES, _ARRIVES = 0.3, 0.7
"""A value has left its level at the first part of the way to the other one, and has arrived at the second."""
_ITERATIONS = 50


@dataclass(frozen=True)
class Levels:
    """The two levels of a value, and the scatter about them."""

    low: float
    high: float
    scatter: float

    @property
    def contrast(self) -> float:
        """Distance of the levels in multiples of the scatter; 0 for a constant value."""
        return (self.high - self.low) / self.scatter if self.high > self.low else 0.0

    def share(self, values: Floats) -> Floats:
        """Return values as parts of the way from the low to the high level."""
        return (values - self.low) / (self.high - self.low)


@dataclass(frozen=True)
class Edges:
    """Edges of one value, the earliest first.

    Attributes
    ----------
    time_s, std_s : ndarray, shape (n,)
        Times of the edges, and their standard deviations, because an edge lies between two values.
    rising : ndarray of bool, shape (n,)
    """

    time_s: Floats
    std_s: Floats
    rising: NDArray[np.bool_]

    def within(self, first_s: float, last_s: float, most: int) -> "Edges":
        """Return at most `most` edges between two times, the earliest ones."""
        chosen = np.flatnonzero((self.time_s >= first_s) & (self.time_s <= last_s))[:most]
        return Edges(self.time_s[chosen], self.std_s[chosen], self.rising[chosen])

    @classmethod
    def between(cls, intervals: list[tuple[float, float]], rising: list[bool]) -> "Edges":
        """Return edges of which each lies anywhere in an interval of times."""
        first, last = np.array(intervals, np.float64).reshape(-1, 2).T
        return cls((first + last) / 2, (last - first) / math.sqrt(12.0), np.array(rising, np.bool_))


def levels_of(values: Floats) -> Levels:
    """Return the two levels about which values lie, by dividing them where both means are equally far."""
    border = (float(values.min()) + float(values.max())) / 2
    low = high = border
    for _ in range(_ITERATIONS):
        above = values > border
        if not above.any() or above.all():
            break
        low, high = float(values[~above].mean()), float(values[above].mean())
        if (low + high) / 2 == border:
            break
        border = (low + high) / 2
    above = values > border
    # Values on the way from one level to the other are few, and must not count as scatter.
    distances = np.abs(values - np.where(above, high, low))
    scatter = 1.4826 * float(np.median(distances))
    tiny = 1e-9 * max(abs(low), abs(high), 1e-300)
    return Levels(low, high, max(scatter, tiny))


def edges_of_signal(time_s: Floats, values: Floats, levels: Levels) -> Edges:
    """Return the edges of the samples of a signal, where they pass the middle between both levels."""
    shares = levels.share(values)
    intervals, rising = [], []
    for last, first, rises in switches(shares):
        # of the samples from one level to the other, the two about the middle
        before = last + int(np.argmax((shares[last + 1 : first + 1] > 0.5) == rises))
        part = (0.5 - shares[before]) / (shares[before + 1] - shares[before])
        gap_s = time_s[before + 1] - time_s[before]
        middle_s = time_s[before] + part * gap_s
        intervals.append((middle_s - gap_s / 2, middle_s + gap_s / 2))
        rising.append(rises)
    return Edges.between(intervals, rising)


def edges_of_light(
    middle_s: Floats, length_s: Floats, values: Floats, levels: Levels, *, saturated: bool
) -> Edges:
    """Return the edges of the brightness of images.

    Parameters
    ----------
    middle_s, length_s : ndarray, shape (n,)
        Middles and lengths of the exposures; a length is 0 if it is unknown.
    values : ndarray, shape (n,)
        Brightness of each image.
    levels : Levels
    saturated : bool
        True if the pixels of the high level are at the end of their range. The brightness of an image during
        whose exposure the light switched tells the moment otherwise.
    """
    shares = levels.share(values)
    begins_s, ends_s = middle_s - length_s / 2, middle_s + length_s / 2
    intervals, rising = [], []
    for last, first, rises in switches(shares):
        rising.append(rises)
        if saturated:
            # one bright moment is enough for a bright image
            interval = (ends_s[last], ends_s[first]) if rises else (begins_s[last], begins_s[first])
        elif first == last + 2 and length_s[last + 1] > 0.0:
            # the image between both was exposed while the light switched
            part = 1.0 - shares[last + 1] if rises else shares[last + 1]
            at_s = begins_s[last + 1] + float(np.clip(part, 0.0, 1.0)) * length_s[last + 1]
            spread_s = length_s[last + 1] / levels.contrast
            interval = (at_s - spread_s, at_s + spread_s)
        else:
            interval = (ends_s[last], begins_s[first])
        intervals.append((min(interval), max(interval)))
    return Edges.between(intervals, rising)


def switches(shares: Floats) -> list[tuple[int, int, bool]]:
    """Return for each change of level the last value at the old one, the first at the new one, and if it
    rises."""
    found = []
    level: bool | None = None
    last = 0
    for k, share in enumerate(shares.tolist()):
        here = True if share >= _ARRIVES else False if share <= _LEAVES else None
        if here is None:
            continue
        if level is not None and here != level:
            found.append((last, k, here))
        level, last = here, k
    return found
