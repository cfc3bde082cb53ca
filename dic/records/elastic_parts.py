"""The parts of a tensile test in which the strain is a known kind of function of the load.

- The start: from the first image up to half of the load at which the specimen begins to yield. The strain is
  a linear function of the load.
- The falls: while the load falls and rises again, or falls to the end of the test. Here the function may be
  slightly curved, and the strain while the load falls may differ a little from the strain while it rises. A
  fall because of necking or of the break is left out: its strain does not fall in proportion to the load.

The load is 0 at the first point of the record; its range is 1.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dic.typing import Float, Indices

TOP_SHARES, _RISEN_SHARE = (0.25, 0.5), 0.02
"""Shares of the largest load. At first, the start ends at the first one, or at the second one if few images
are below the first. Some images must exceed the last share.
"""
LEAST_RISEN, LEAST_IMAGES, _LEAST_AT_REST, _LEAST_OF_FALL = 5, 8, 3, 6
_YIELD_STRAIN, _YIELD_STDS, _YIELD_SHARE, _LEAST_TOP = 1e-4, 3.0, 0.5, 0.05
"""The specimen yields where the strain exceeds the elastic line by this strain and this number of standard
deviations. The start ends at this share of the load, and not below the last share of the largest load.
"""
_FALL_SHARE, _FALL_TOP, _FALL_INTERVALS = 0.3, 0.8, 4.0
"""A fall is one by this share of the largest load, from the second share of its peak, over this time."""
_SLOPES = 0.6, 1.5
"""Limits of the slope in a fall, divided by the slope at the start."""


@dataclass(frozen=True)
class Part:
    """The images of one part."""

    images: Indices
    is_fall: bool = False
    is_at_rest: bool = False
    """True if some images show the specimen at rest before the load rises."""

    def design(self, load: Float) -> tuple[Float, Float]:
        """Return the functions of the load whose sum is the strain, and their derivatives, as columns."""
        one, none = np.ones(len(load)), np.zeros(len(load))
        if self.is_at_rest:
            return np.column_stack([one, load]), np.column_stack([none, one])
        if not self.is_fall:
            # Without a sudden rise, a wrong clock looks like yielding.
            return np.column_stack([one, load, load**2]), np.column_stack([none, one, 2.0 * load])
        height = (load - load.min()) / max(float(np.ptp(load)), 1e-12)
        loop = 4.0 * height * (1.0 - height) * np.where(np.arange(len(load)) <= int(np.argmin(load)), 1, -1)
        return np.column_stack([one, load, load**2, loop]), np.column_stack([none, one, 2.0 * load, none])


def rise_of(load: Float, strain: Float) -> tuple[float, Float]:
    """Return the slope of strain against load, and the residual of the strain."""
    across = load - load.mean()
    slope = float(across @ strain) / max(float(across @ across), 1e-300)
    return slope, strain - strain.mean() - slope * across


class ElasticParts:
    """The elastic parts of a record.

    `time_s`, `load`, shape (n,): the record. `interval_s`: time between two images.
    """

    def __init__(self, time_s: Float, load: Float, interval_s: float) -> None:
        self._time_s, self._load = time_s, load
        self._most = float(load.max())
        self.risen = _RISEN_SHARE * self._most
        steps = max(1, int(np.searchsorted(time_s - time_s[0], 0.2 * interval_s)))
        least_s = _FALL_INTERVALS * interval_s
        self.falls = [(first, last) for first, low, last in self._falls(steps) if low - first >= least_s]

    def top(self, load: Float, strain: Float, top: float) -> float:
        """Return the load at which the start ends: half of the load at which the specimen begins to yield.

        `load`, `strain`, shape (images,): load and strain of each image. `top`: a first estimate.
        """
        rising = slice(0, int(np.argmax(load)) + 1)
        load, strain = load[rising], strain[rising]
        low = load <= top
        if np.count_nonzero(low) < LEAST_IMAGES:
            return top
        slope, rest = rise_of(load[low], strain[low])
        std = float(np.sqrt(rest @ rest / (len(rest) - 2)))
        over = strain - strain[low].mean() - slope * (load - load[low].mean())
        out = over > _YIELD_STRAIN + _YIELD_STDS * std
        out[:-1] &= out[1:]
        yielding = float(load[int(np.argmax(out))]) if out.any() else self._most
        return max(_YIELD_SHARE * yielding, _LEAST_TOP * self._most)

    def start(self, at_s: Float, load: Float, top: float) -> Part | None:
        """Return the images of the start; None if too few show a rise of the load.

        `at_s`, `load`, shape (images,): machine's time and load of each image.
        """
        above = self._load > top
        end_s = float(self._time_s[int(np.argmax(above))]) if above.any() else float(self._time_s[-1])
        images = np.flatnonzero(at_s <= end_s)
        risen = np.count_nonzero(load[images] > self.risen)
        if len(images) < LEAST_IMAGES or risen < LEAST_RISEN:
            return None
        return Part(images, is_at_rest=bool(len(images) - risen >= _LEAST_AT_REST))

    def later(self, at_s: Float, load: Float, strain: Float, start: Part) -> Iterator[Part]:
        """Yield the images of each fall whose strain falls in proportion to the load."""
        usual, _ = rise_of(load[start.images], strain[start.images])
        for first_s, last_s in self.falls:
            images = np.flatnonzero((at_s >= first_s) & (at_s <= last_s))
            if len(images) >= _LEAST_OF_FALL:
                slope, _ = rise_of(load[images], strain[images])
                if _SLOPES[0] * usual < slope < _SLOPES[1] * usual:
                    yield Part(images, True)

    def _falls(self, step: int) -> Iterator[tuple[float, float, float]]:
        """Yield the times at which each fall begins, is lowest and ends. `step`: points to go on at once."""
        load, time_s = self._load[::step], self._time_s[::step]
        peak, low, falling = 0, 0, False
        for k, value in enumerate(load):
            if not falling and value >= load[peak]:
                peak = k
            elif not falling and load[peak] - value > _FALL_SHARE * self._most:
                falling, low = True, k
            elif falling and value < load[low]:
                low = k
            if falling and (value >= _FALL_TOP * load[peak] or k == len(load) - 1):
                high = np.flatnonzero(load[peak : low + 1] >= _FALL_TOP * load[peak])
                yield float(time_s[peak + high[-1]]), float(time_s[low]), float(time_s[k])
                peak, falling = k, False
