"""Find the offset between the clocks of a camera and a testing machine from strain and load.

At the beginning of a tensile test, strain is proportional to load. So at the right offset, the strain of the
images up to a quarter of the largest load is a linear function of the load. A wrong offset bends this line
and makes its residual larger. The offset with the least residual is chosen. Its standard deviation follows
from the residual, and from how strongly a wrong offset bends the line. If the load grows evenly from the
first image to the last, no offset bends the line, and the offset cannot be found. Images of the specimen at
rest before the test make it possible to find the offset.
"""

import numpy as np

from dic.records.machine import MachineRecord
from dic.typing import Float, Mask

_TOP_SHARE, _RISEN_SHARE = 0.25, 0.02
"""Shares of the largest load. Images up to the first share are used; some of them must be above the
second.
"""
_LEAST_RISEN, _LEAST_IMAGES = 5, 8
_TRIALS_PER_IMAGE = 4
_MOST_TRIALS = 20_000
_ROUNDS = 3
_MOST_SHARE = 0.5
"""Largest accepted standard deviation of the offset, divided by the time between two images."""


def find_offset(record: MachineRecord, image_times_s: Float, strain: Float) -> tuple[float, float]:
    """Return the machine's time minus the images' time, and the standard deviation of this offset, s.

    `record`: a record that has times. `image_times_s`, `strain`, shape (images,): time and strain of each
    image; NaN for an image without strain.

    Raises `CurveError` if the images do not fit into the record, or strain and load do not determine the
    offset.
    """
    if record.time_s is None:
        raise ValueError("an offset needs times")
    known = np.isfinite(strain)
    start = _Start(record, record.time_s, image_times_s[known], strain[known])
    low, high = float(record.time_s[0] - image_times_s[0]), float(record.time_s[-1] - image_times_s[-1])
    remedy = "give the offset with --offset-s"
    if high < low:
        taken, recorded = np.ptp(image_times_s), np.ptp(record.time_s)
        got = f"images over {taken:.6g} s and a record over {recorded:.6g} s"
        raise record.wrong("find the offset", "images that overlap with the record", got, remedy)
    interval_s = float(np.median(np.diff(image_times_s))) if len(image_times_s) > 1 else np.inf
    count = int(min(_MOST_TRIALS, 2 + _TRIALS_PER_IMAGE * (high - low) / max(interval_s, 1e-9)))
    trials = np.linspace(low, high, count)
    costs = np.array([start.variance(trial) for trial in trials])
    if not np.isfinite(costs).any():
        expected = f"an offset at which {_LEAST_RISEN} images show the first quarter of the largest load"
        raise record.wrong("find the offset", expected, "none", remedy)
    offset, std = start.refined(float(trials[int(np.argmin(costs))]), interval_s)
    limit = _MOST_SHARE * interval_s
    if not std <= limit:
        got = f"one known to ± {std:.3g} s only" if np.isfinite(std) else "one that nothing determines"
        expected = f"an offset known to {limit:.3g} s, half of the time between two images"
        raise record.wrong("find the offset", expected, got, remedy)
    return offset, std


class _Start:
    """Fits strain as a linear function of the load at the beginning of a test, for a given offset."""

    def __init__(self, record: MachineRecord, time_s: Float, image_times_s: Float, strain: Float) -> None:
        self._time_s, self._load = time_s, record.load_n - record.load_n[0]
        self._times, self._strain = image_times_s, strain
        self._most = float(self._load.max())
        reached = np.flatnonzero(self._load > _TOP_SHARE * self._most)
        self._end_s = float(time_s[reached[0]]) if reached.size else float(time_s[-1])

    def variance(self, offset_s: float) -> float:
        """Return the residual variance of the strain, divided by the squared slope; infinity if unknown.

        While the specimen is at rest, the residual is small at any offset, but the slope is even smaller.
        Without the division, the search would choose an offset at which the specimen is at rest.
        """
        use = self._images(offset_s)
        if use is None:
            return float("inf")
        rest, _, slope, _ = self._fit(offset_s, use)
        return float(rest @ rest) / (len(rest) - 3) / slope**2 if slope > 0.0 else float("inf")

    def refined(self, offset_s: float, interval_s: float) -> tuple[float, float]:
        """Return the offset with the least residual of the same images, and its standard deviation."""
        from scipy.optimize import minimize_scalar

        for _ in range(_ROUNDS):
            use = self._images(offset_s)
            if use is None:
                break
            near = offset_s - interval_s, offset_s + interval_s
            chosen = use
            offset_s = float(
                minimize_scalar(
                    lambda trial, chosen=chosen: float(np.sum(self._fit(trial, chosen)[0] ** 2)),
                    bounds=near,
                    method="bounded",
                ).x
            )
        return offset_s, float("inf") if use is None else self._std_s(offset_s, use)

    def _std_s(self, offset_s: float, use: Mask) -> float:
        rest, design, slope, at = self._fit(offset_s, use)
        small = 0.25 * float(np.median(np.diff(self._times)))
        ahead, behind = (np.interp(at + step, self._time_s, self._load) for step in (small, -small))
        rate = slope * (ahead - behind) / (2 * small)
        own = rate - design @ np.linalg.lstsq(design, rate, rcond=None)[0]
        information = float(own @ own)
        variance = float(rest @ rest) / (len(rest) - 3)
        if information <= 1e-12 * float(rate @ rate):
            return float("inf")
        # The machine may have taken its reading half a sample earlier or later.
        sampling_s = 0.5 * float(np.median(np.diff(self._time_s)))
        return float(np.sqrt(variance / information + sampling_s**2))

    def _images(self, offset_s: float) -> Mask | None:
        """Return the images up to a quarter of the largest load; None if too few show a rise of the load."""
        at = self._times + offset_s
        use = at <= self._end_s
        load = np.interp(at[use], self._time_s, self._load)
        risen = np.count_nonzero(load > _RISEN_SHARE * self._most)
        return use if len(load) >= _LEAST_IMAGES and risen >= _LEAST_RISEN else None

    def _fit(self, offset_s: float, use: Mask) -> tuple[Float, Float, float, Float]:
        """Return the residual, the design matrix, the slope and the machine times of a fit to the images."""
        at = self._times[use] + offset_s
        load = np.interp(at, self._time_s, self._load)
        design = np.column_stack([np.ones_like(load), load / self._most])
        strain = self._strain[use]
        solution = np.linalg.lstsq(design, strain, rcond=None)[0]
        return strain - design @ solution, design, float(solution[1]) / self._most, at
