"""Find the offset and the rate between the clocks of a camera and a testing machine from strain and load.

While a specimen is elastic, its strain is a linear function of the load. So with the right clock, the strain
of the images is such a function of the load in each elastic part of the test (`dic.records.elastic_parts`). A
wrong clock bends this function wherever the load does not grow evenly: where it begins to rise, at a hold,
and where it falls or rises again. Each such place shows the machine's time at one time of the images. One
place determines the offset; a second one, long after the first, also determines the rate. Other parts of the
curve are not used, because the function is not known there: if the load grows evenly, a wrong rate looks like
another material.

The clock with the least residual is chosen. What is known before counts like a further measurement. If the
load grows evenly from the first image to the last, the offset cannot be found. Images of the specimen at rest
before the test make it possible.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dic.records.clock import FOUND, SMOOTHED_INTERVALS, MachineClock, smoothed, usual_interval_s
from dic.records.elastic_parts import LEAST_RISEN, TOP_SHARES, ElasticParts, Part, rise_of
from dic.records.machine import MachineRecord
from dic.typing import Float

_TRIALS_PER_IMAGE, _MOST_TRIALS, _RATE_TRIALS = 4, 20_000, 121
_MOST_INTERVALS, _MOST_RATE_STD = (0.5, 1.5), 0.01
"""Largest accepted standard deviations: of the offset, in intervals between two images, without and with
images at rest, and of the rate.
"""
_RATE_STDS, _MOST_RATE_CHANGE = 3.0, 0.05
"""The rate is searched up to this number of standard deviations, and up to this change."""
_HYSTERESIS = 0.01
"""Standard deviation of the difference of strain between falling and rising load, divided by the range."""
_EXACT = 1e-7
_IMPROVED = 0.9


def find_clock(
    record: MachineRecord, image_times_s: Float, strain: Float, known: MachineClock
) -> MachineClock:
    """Return the machine's clock, with standard deviations.

    `record`: a record that has times. `image_times_s`, `strain`, shape (images,): time and strain of each
    image; NaN for an image without strain. `known`: what is known before.

    Raises `CurveError` if the images do not fit into the record, or strain and load do not determine the
    clock.
    """
    if record.time_s is None:
        raise ValueError("a clock needs times")
    fit = _Fit(record, record.time_s, image_times_s, strain, known)
    clock = known
    if np.isinf(known.offset_std_s):
        clock = _searched(fit, record, record.time_s, image_times_s, known)
    found = fit.refined(clock)
    if np.isinf(known.rate_std) and not found.rate_std <= _MOST_RATE_STD:
        expected = f"a rate known to {_MOST_RATE_STD:.0%}, from changes of the load at two times"
        got = _known_to(found.rate_std, f"{found.rate_std:.2%}")
        raise record.wrong("find the clock's rate", expected, got, "give the rate with --clock-rate")
    limit = _MOST_INTERVALS[fit.is_at_rest] * fit.interval_s
    if np.isinf(known.offset_std_s) and not found.offset_std_s <= limit:
        expected = f"an offset known to {limit:.3g} s, as from images at rest before the test"
        got = _known_to(found.offset_std_s, f"{found.offset_std_s:.3g} s")
        raise record.wrong("find the offset", expected, got, "give the offset with --offset-s")
    better = found.offset_std_s < _IMPROVED * known.offset_std_s, found.rate_std < _IMPROVED * known.rate_std
    return replace(
        found,
        offset_from=FOUND if better[0] else known.offset_from,
        rate_from=FOUND if better[1] else known.rate_from,
    )


def _known_to(std: float, text: str) -> str:
    return f"one known to ± {text} only" if np.isfinite(std) else "one that nothing determines"


def _searched(
    fit: "_Fit", record: MachineRecord, time_s: Float, image_times_s: Float, known: MachineClock
) -> MachineClock:
    """Return the clock of the offset with the least residual at the beginning of the test."""
    remedy = "give the offset with --offset-s"
    span_s = known.rate * float(np.ptp(image_times_s))
    low, high = float(time_s[0] - image_times_s[0]), float(time_s[-1] - image_times_s[0] - span_s)
    if high < low:
        got = f"images over {span_s:.6g} s and a record over {np.ptp(time_s):.6g} s"
        raise record.wrong("find the offset", "images that overlap with the record", got, remedy)
    count = int(min(_MOST_TRIALS, 2 + _TRIALS_PER_IMAGE * (high - low) / max(fit.interval_s, 1e-9)))
    trials = [replace(known, offset_s=float(trial)) for trial in np.linspace(low, high, count)]
    for fit.top_share in TOP_SHARES:
        costs = np.array([fit.variance(trial) for trial in trials])
        if np.isfinite(costs).any():
            return trials[int(np.argmin(costs))]
    expected = f"an offset at which {LEAST_RISEN} images show the first half of the largest load"
    raise record.wrong("find the offset", expected, "none", remedy)


class _Fit:
    """Fits strain as a function of the load in the elastic parts of a test."""

    def __init__(
        self,
        record: MachineRecord,
        time_s: Float,
        image_times_s: Float,
        strain: Float,
        known: MachineClock,
    ) -> None:
        seen = np.isfinite(strain)
        self.interval_s = max(usual_interval_s(image_times_s), 1e-9)
        self._known, self._first_s, self._time_s = known, float(image_times_s[0]), time_s
        self._times, self._strain = image_times_s[seen], strain[seen]
        load = smoothed(record.load_n, time_s, SMOOTHED_INTERVALS * self.interval_s)
        self._load = (load - load[0]) / max(float(np.ptp(load)), 1e-300)
        # Noise in the rate would look like a load that does not grow evenly, so the rate is a mean.
        step_s = min(self.interval_s, float(np.ptp(time_s)))
        ends = [np.clip(time_s + step, time_s[0], time_s[-1]) for step in (step_s, -step_s)]
        ahead, behind = (np.interp(end, time_s, self._load) for end in ends)
        self._rate = smoothed((ahead - behind) / np.maximum(ends[0] - ends[1], 1e-9), time_s, step_s)
        self._parts = ElasticParts(time_s, self._load, self.interval_s)
        self._std, self.is_at_rest, self.top_share = 0.0, False, TOP_SHARES[0]

    def variance(self, clock: MachineClock) -> float:
        """Return the residual variance of the strain, divided by the squared slope; infinity if unknown.

        While the specimen is at rest, the residual is small at any offset, but the slope is even smaller.
        Without the division, the search would choose an offset at which the specimen is at rest.
        """
        at, load = self._joined(clock)
        start = self._parts.start(at, load, self.top_share * float(self._load.max()))
        if start is None:
            return float("inf")
        load, strain = load[start.images], self._strain[start.images]
        slope, rest = rise_of(load, strain)
        return float(rest @ rest) / (len(rest) - 3) / slope**2 if slope > 0.0 else float("inf")

    def refined(self, clock: MachineClock) -> MachineClock:
        """Return the clock with the least residual near the given one, and its standard deviations."""
        top = self.top_share * float(self._load.max())
        # The start alone hardly shows the rate, so the rate may not move far at first.
        usual = min(self._known.rate_std, _MOST_RATE_STD)
        for _ in range(2):
            at, load = self._joined(clock)
            top = self._parts.top(load, self._strain, top)
            start = self._parts.start(at, load, top)
            if start is None:
                return replace(clock, offset_std_s=np.inf)
            self.is_at_rest = start.is_at_rest
            clock = self._solved(clock, [start], usual)
        if self._parts.falls:
            clock = self._nearest_rate(clock, top)
        for _ in range(2):
            parts = self._all(clock, top)
            clock = self._solved(clock, parts, self._known.rate_std) if parts else clock
        return clock

    def _joined(self, clock: MachineClock) -> tuple[Float, Float]:
        at = clock.at(self._times, self._first_s)
        return at, np.interp(at, self._time_s, self._load)

    def _all(self, clock: MachineClock, top: float) -> list[Part]:
        """Return the start and the later parts; an empty list if the start is not known at this clock."""
        at, load = self._joined(clock)
        start = self._parts.start(at, load, top)
        return [] if start is None else [start, *self._parts.later(at, load, self._strain, start)]

    def _nearest_rate(self, clock: MachineClock, top: float) -> MachineClock:
        """Return the clock of the rate with the least residual; the time of the first rise stays the same."""
        _, load = self._joined(clock)
        rise_s = float(self._times[int(np.argmax(load > self._parts.risen))]) - self._first_s
        reach = min(_RATE_STDS * self._known.rate_std, _MOST_RATE_CHANGE)
        best, least = clock, np.inf
        for change in np.linspace(-reach, reach, _RATE_TRIALS if reach > _EXACT else 1):
            rate = self._known.rate + float(change)
            trial = replace(clock, rate=rate, offset_s=clock.offset_s - (rate - clock.rate) * rise_s)
            parts = self._all(trial, top)
            rest, _, free = self._residual(trial, parts) if len(parts) > 1 else (np.ones(1), None, 0)
            if (cost := float(rest @ rest) / free if free > 0 else np.inf) < least:
                best, least = trial, cost
        return best

    def _solved(self, clock: MachineClock, parts: Sequence[Part], rate_std: float) -> MachineClock:
        """Return the clock with the least sum of squares in the given parts, and its standard deviations.

        `rate_std`: standard deviation of the rate that is known before.
        """
        from scipy.optimize import least_squares

        # Both unknowns are in units of one interval, at the first and at the last image.
        unit = np.array([self.interval_s, self.interval_s / max(float(np.ptp(self._times)), 1e-9)])
        stds = np.array([self._known.offset_std_s, rate_std]) / unit
        expected = np.array([self._known.offset_s, self._known.rate]) / unit
        weights = np.diag(1.0 / np.maximum(stds, _EXACT))
        std = self._std_of(clock, parts)

        def clock_of(x: Float) -> MachineClock:
            return replace(clock, offset_s=float(x[0] * unit[0]), rate=float(x[1] * unit[1]))

        def rest_of(x: Float) -> Float:
            return np.concatenate([self._residual(clock_of(x), parts)[0] / std, weights @ (x - expected)])

        def change_of(x: Float) -> Float:
            return np.vstack([self._residual(clock_of(x), parts)[1] * unit / std, weights])

        start = np.array([clock.offset_s, clock.rate]) / unit
        x = least_squares(rest_of, start, jac=change_of).x
        clock = clock_of(x)
        std = self._std_of(clock, parts)
        normal = change_of(x).T @ change_of(x)
        if np.linalg.cond(normal) > 1e13:
            return replace(clock, offset_std_s=np.inf, rate_std=np.inf)
        covariance = np.linalg.inv(normal)
        own = np.sqrt(np.diag(covariance))
        correlation = float(covariance[0, 1] / (own[0] * own[1]))
        stds = own * unit
        return replace(clock, offset_std_s=float(stds[0]), rate_std=float(stds[1]), correlation=correlation)

    def _std_of(self, clock: MachineClock, parts: Sequence[Part]) -> float:
        """Return the standard deviation of the strain about its function of the load."""
        for _ in range(2):
            rest, _, free = self._residual(clock, parts)
            self._std = max(float(np.sqrt(rest @ rest / max(free - 2, 1))), 1e-12)
        return self._std

    def _residual(self, clock: MachineClock, parts: Sequence[Part]) -> tuple[Float, Float, int]:
        """Return the residual of the strain in all parts, and its change with offset and rate.

        The third value is the number of images minus the number of coefficients.
        """
        at, load = self._joined(clock)
        rate = np.interp(at, self._time_s, self._rate)
        passed = np.column_stack([np.ones(len(at)), self._times - self._first_s])
        rests, changes, free = [], [], 0
        for part in parts:
            images = part.images
            strain, design, slopes = self._strain[images], *part.design(load[images])
            free += len(images) - design.shape[1] + part.is_fall
            if part.is_fall:
                # The last coefficient is the strain by hysteresis; it is 0 with a standard deviation.
                row = np.zeros((1, design.shape[1]))
                row[0, -1] = self._std / (_HYSTERESIS * float(np.ptp(strain)))
                design, strain = np.vstack([design, row]), np.append(strain, 0.0)
            solution = np.linalg.lstsq(design, strain, rcond=None)[0]
            change = np.zeros((len(strain), 2))
            change[: len(images)] = (slopes @ solution * rate[images])[:, None] * passed[images]
            rests.append(design @ solution - strain)
            changes.append(change - design @ np.linalg.lstsq(design, change, rcond=None)[0])
        return np.concatenate(rests), np.vstack(changes), free
