"""Estimate a measured signal at given times from its samples, with its slope and its standard deviation.

Where samples are dense, a straight line is fitted to those within 0.1 s around the time. This is a whole
number of periods of mains hum at 50 Hz and at 60 Hz, so the hum cancels. The noise of such a value is taken
from the same values at neighbouring times of the record: the second difference of three of them does not
depend on a straight course of the signal, and contains noise of every kind as it is left after the fit.
Where samples are sparse, such as readings every 0.1 s, the value lies on the straight line between the two
samples around the time.

A signal need not be straight. A bend shows in the second difference about the time, and a jump in the
residuals of the fit; both enlarge the standard deviation. A value between two steps of the resolution is not
known better than the resolution tells. No value is extrapolated.
"""

from dataclasses import dataclass, field

import numpy as np

from dic.runfile.line_fits import LineFits, fit_lines, running_level, running_std
from dic.typing import Float, Indices, Mask

WIDTH_S = 0.1
LEAST_DENSE = 4
"""Smallest number of samples within `WIDTH_S` to which a line is fitted."""
SLOPE_S, SLOPE_SAMPLES = 0.5, 2.5
"""The slope is that of a line over the larger one of both: a time, and twice a number of usual intervals."""
MOST_GAP_S, MOST_GAP_SAMPLES = 2.0, 10.0
"""The record covers a time if the samples around it are nearer to each other than the larger one of both: a
time, and a number of usual intervals.
"""
_NEAR, _LEAST = 100, 8
"""The noise is a median over the first number of values before and after; fewer values than the second number
do not tell it.
"""
_MOST_DIFFERENT, _ROUNDING = 0.5, 1e-12
"""Values show the resolution of a signal if at most this share of them is different. Smaller differences than
the second share of the largest value are errors of rounding.
"""
_BESIDE = 10
"""The change beyond the record follows from this number of samples before and after."""
_SECOND = 6.0
"""Variance of the second difference of independent values with a variance of 1."""
_BEND_SHARE = 1.0 / 6.0
"""A line that is fitted about a sharp bend misses it by this share of the second difference."""
_JUMP_TIMES, _SURE = 2.0, 4.0
"""A line that is fitted about a jump misses the value by at most the first multiple of the residuals'
standard deviation. Only what exceeds the noise by the second number of standard deviations counts.
"""


@dataclass(frozen=True)
class Estimates:
    """A signal at given times; all arrays have the shape of the times.

    Attributes
    ----------
    value, slope : ndarray
        Value, and its change per second over a longer time; NaN where the record does not cover the time.
    noise : ndarray
        Standard deviation of the value by noise. The noise of two values that are `apart_s` from each other
        is independent.
    course : ndarray
        Standard deviation of the value because the course of the signal near the time is not known: a bend, a
        jump, or the resolution.
    apart_s : ndarray
    """

    value: Float
    slope: Float
    noise: Float
    course: Float
    apart_s: Float

    @classmethod
    def none(cls, count: int) -> "Estimates":
        """Return estimates without a value."""
        return cls(*(np.full(count, np.nan) for _ in range(5)))


@dataclass(frozen=True)
class SignalRecord:
    """The valid samples of a signal, the earliest first.

    Attributes
    ----------
    time_s, values : ndarray, shape (n,)
    time_std_s : ndarray, shape (n,)
        Standard deviation of the part of each sample's time that is independent of the other samples.
    std : float
        Declared standard deviation of the noise of one sample; 0 if it is unknown.
    invalid_s : ndarray, shape (m,)
        Times of the samples that have no valid value, in their order.
    """

    time_s: Float
    values: Float
    time_std_s: Float
    std: float = 0.0
    invalid_s: Float = field(default_factory=lambda: np.zeros(0))

    @classmethod
    def of(
        cls, time_s: Float, values: Float, time_std_s: Float | float = 0.0, std: float = 0.0
    ) -> "SignalRecord":
        """Return the record of samples in any order of times; NaN marks a sample without a valid value."""
        order = np.argsort(time_s, kind="stable")
        time_s, values = time_s[order], values[order]
        valid = np.isfinite(values)
        own_std_s = np.broadcast_to(np.asarray(time_std_s, np.float64), time_s.shape)[order]
        return cls(time_s[valid], values[valid], own_std_s[valid], std, time_s[~valid])

    @property
    def resolution(self) -> float:
        """The least difference between two different values; 0 if most values occur only once.

        NaN if the values never change, so that they do not tell it.
        """
        steps = np.diff(np.unique(self.values))
        steps = steps[steps > _ROUNDING * np.abs(self.values).max(initial=0.0)]
        if not len(steps):
            return np.nan
        return float(steps.min()) if len(steps) + 1 <= _MOST_DIFFERENT * len(self.values) else 0.0

    @property
    def most_gap_s(self) -> float:
        """The longest time between two samples between which the signal counts as known."""
        return max(MOST_GAP_S, MOST_GAP_SAMPLES * self.usual_interval_s)

    @property
    def usual_interval_s(self) -> float:
        """The usual time between two samples; 0 for a single one."""
        return float(np.median(np.diff(self.time_s))) if len(self.time_s) > 1 else 0.0

    def is_invalid_near(self, at_s: Float) -> Mask:
        """Return True for the times beside which a sample has no valid value."""
        found = [np.searchsorted(self.invalid_s, at_s + sign * self.most_gap_s) for sign in (1.0, -1.0)]
        return np.asarray(found[0] > found[1])

    def std_beyond(self, at_s: Float) -> Float:
        """Return by how much the signal may differ from the nearest sample at times that are not covered.

        This is the steepest change among the samples near that one, over the time from it, with the noise and
        the resolution of a sample; NaN for fewer than two samples.
        """
        if len(self.time_s) < 2:
            return np.full(len(at_s), np.nan)
        with np.errstate(divide="ignore", invalid="ignore"):
            slopes = np.abs(np.diff(self.values) / np.diff(self.time_s))
        slopes = np.where(np.isfinite(slopes), slopes, 0.0)
        nearest = np.searchsorted(0.5 * (self.time_s[1:] + self.time_s[:-1]), at_s)
        steepest = [slopes[max(0, k - _BESIDE) : k + _BESIDE].max() for k in nearest]
        change = np.array(steepest) * np.abs(at_s - self.time_s[nearest])
        return np.asarray(np.sqrt(change**2 + self.std**2 + np.nan_to_num(self.resolution) ** 2 / 12.0))


def estimate(record: SignalRecord, at_s: Float, length_s: Float | float = 0.0) -> Estimates:
    """Return a signal at given times.

    Parameters
    ----------
    record : SignalRecord
    at_s : ndarray, shape (k,)
        The times, in any order.
    length_s : ndarray, shape (k,), or float
        Length of the exposure around each time. The value is the mean over a longer exposure than 0.1 s.
    """
    if len(record.time_s) < 2 or not len(at_s):
        return Estimates.none(len(at_s))
    half_s = 0.5 * np.maximum(WIDTH_S, np.broadcast_to(np.nan_to_num(length_s), at_s.shape))
    about = _Course(record)
    slope = about.slope(at_s)
    dense, sparse = about.dense(at_s, half_s, slope), about.sparse(at_s, slope)
    use = np.isfinite(dense.value)
    covered = about.covered(at_s, half_s)
    pairs = zip(vars(dense).values(), vars(sparse).values(), strict=True)
    return Estimates(*(np.where(covered, np.where(use, one, other), np.nan) for one, other in pairs))


class _Course:
    """The course of a signal: lines about its times, and its noise along the record."""

    def __init__(self, record: SignalRecord) -> None:
        self._record, self._resolution = record, record.resolution
        first_s, last_s = float(record.time_s[0]), float(record.time_s[-1])
        self._lattice_s = np.arange(first_s + 0.5 * WIDTH_S, last_s - 0.5 * WIDTH_S, WIDTH_S)
        fits = self._lines(self._lattice_s, np.full(len(self._lattice_s), 0.5 * WIDTH_S))
        self._residual = running_level(fits.residual, _NEAR, 1)
        second = fits.value[:-2] - 2.0 * fits.value[1:-1] + fits.value[2:]
        variance = running_std(second, _NEAR, _LEAST) ** 2 / _SECOND
        # The variance of a value divided by its leverage is that of one sample, if the noise is white.
        leverage = running_level(fits.leverage[1:-1], _NEAR, 1)
        self._of_sample = np.pad(variance / leverage, 1, mode="edge") if len(second) else np.zeros(0)

    def _lines(self, at_s: Float, half_s: Float) -> LineFits:
        record = self._record
        return fit_lines(record.time_s, record.values, record.time_std_s, at_s, half_s, LEAST_DENSE)

    def _along(self, values: Float, at_s: Float) -> Float:
        """Return values of the lattice at other times; NaN if there are none."""
        known = np.isfinite(values)
        if not known.any():
            return np.full(len(at_s), np.nan)
        return np.interp(at_s, self._lattice_s[: len(values)][known], values[known])

    def slope(self, at_s: Float) -> Float:
        """Return the slope of longer lines, which has less noise than that of the lines for the values."""
        half_s = np.full(len(at_s), max(0.5 * SLOPE_S, SLOPE_SAMPLES * self._record.usual_interval_s))
        record = self._record
        return fit_lines(record.time_s, record.values, record.time_std_s, at_s, half_s, 2).slope

    def dense(self, at_s: Float, half_s: Float, slope: Float) -> Estimates:
        """Return the values of lines; NaN where too few samples are around a time."""
        fits = self._lines(at_s, half_s)
        slope = np.where(np.isfinite(slope), slope, fits.slope)
        usual = self._along(self._residual, at_s)
        usual = np.where(np.isfinite(usual), usual, fits.residual)
        of_sample = self._along(self._of_sample, at_s)
        of_sample = np.where(np.isfinite(of_sample), of_sample, usual)
        noise = of_sample * fits.leverage
        noise = np.fmax(noise, self._declared(fits.leverage, slope, fits.by_time))
        freedom = np.maximum(fits.count - 2.0, 1.0)
        # Samples that change between two neighbouring steps of the resolution are no jump.
        step = np.nan_to_num(self._resolution)
        expected = usual * (1.0 + _SURE * np.sqrt(2.0 / freedom)) + 0.25 * step**2
        beyond = np.fmax(fits.residual - expected, 0.0)
        ends = [self._lines(at_s + sign * 2.0 * half_s, half_s).value for sign in (1.0, -1.0)]
        second = ends[0] - 2.0 * fits.value + ends[1]
        bend = np.fmax(second**2 - _SURE * _SECOND * noise, 0.0) * _BEND_SHARE**2
        course = bend + _JUMP_TIMES**2 * beyond + self._rounded(usual)
        return Estimates(fits.value, slope, np.sqrt(noise), np.sqrt(course), 2.0 * half_s)

    def sparse(self, at_s: Float, slope: Float) -> Estimates:
        """Return values on the straight lines between the samples; NaN where the record does not reach."""
        time_s, values = self._record.time_s, self._record.values
        of_sample = self._noise_of_sample(at_s)
        before, share, interval_s = self._around(at_s)
        y = [values[np.clip(before + k, 0, len(values) - 1)] for k in range(-1, 3)]
        t = [time_s[np.clip(before + k, 0, len(values) - 1)] for k in range(-1, 3)]
        with np.errstate(divide="ignore", invalid="ignore"):
            slopes = [(y[k + 1] - y[k]) / (t[k + 1] - t[k]) for k in range(3)]
        chord = np.nan_to_num(slopes[1])
        slope = np.where(np.isfinite(slope), slope, chord)
        value = y[1] + chord * share * interval_s
        leverage = (1.0 - share) ** 2 + share**2
        stds_s = [self._record.time_std_s[np.clip(before + k, 0, len(values) - 1)] for k in (0, 1)]
        by_time = ((1.0 - share) * stds_s[0]) ** 2 + (share * stds_s[1]) ** 2
        noise = np.fmax(of_sample * leverage, self._declared(leverage, slope, by_time))
        # A bend between the samples leads to a value between this line and the lines before and after it.
        aside = [
            np.nan_to_num(slopes[0] - chord) * share * interval_s,
            np.nan_to_num(chord - slopes[2]) * (1.0 - share) * interval_s,
        ]
        parts = np.array([share, 1.0 - share]) ** 2
        bends = np.fmax(np.array(aside) ** 2 - _SURE * _SECOND * of_sample * parts, 0.0)
        course = bends.max(axis=0) / 3.0 + self._rounded(of_sample)
        return Estimates(value, slope, np.sqrt(noise), np.sqrt(course), interval_s)

    def covered(self, at_s: Float, half_s: Float) -> Mask:
        """Return True for the times that the record covers, without an invalid sample nearby."""
        before, _, interval_s = self._around(at_s)
        time_s, bad_s = self._record.time_s, self._record.invalid_s
        inside = (at_s >= time_s[0]) & (at_s <= time_s[-1])
        low, high = np.minimum(at_s - half_s, time_s[before]), np.maximum(at_s + half_s, time_s[before + 1])
        clean = np.searchsorted(bad_s, low, "left") == np.searchsorted(bad_s, high, "right")
        return np.asarray(inside & (interval_s <= self._record.most_gap_s) & clean)

    def _around(self, at_s: Float) -> tuple[Indices, Float, Float]:
        """Return the sample before each time, the share of the interval behind it, and the interval."""
        time_s = self._record.time_s
        before = np.clip(np.searchsorted(time_s, at_s, "right") - 1, 0, len(time_s) - 2)
        interval_s = time_s[before + 1] - time_s[before]
        share = (at_s - time_s[before]) / np.where(interval_s > 0.0, interval_s, 1.0)
        return before, np.clip(share, 0.0, 1.0), interval_s

    def _declared(self, leverage: Float, slope: Float, by_time: Float) -> Float:
        """Return the variance of a value that follows from what is declared."""
        return self._record.std**2 * leverage + slope**2 * by_time

    def _noise_of_sample(self, at_s: Float) -> Float:
        """Return the variance of one sample's noise, from samples and the lines between their neighbours."""
        time_s, y = self._record.time_s, self._record.values
        if len(y) < 3:
            return np.full(len(at_s), self._record.std**2 or np.nan)
        whole_s = np.where(time_s[2:] > time_s[:-2], time_s[2:] - time_s[:-2], 1.0)
        share = (time_s[1:-1] - time_s[:-2]) / whole_s
        off = y[1:-1] - (1.0 - share) * y[:-2] - share * y[2:]
        scaled = off / np.sqrt(1.0 + share**2 + (1.0 - share) ** 2)
        std = running_std(scaled, _NEAR, _LEAST)
        if not np.isfinite(std).any():
            std = np.full(len(scaled), np.sqrt(np.mean(scaled**2)))
        return np.interp(at_s, time_s[1:-1], std) ** 2

    def _rounded(self, of_sample: Float) -> Float:
        """Return the variance of a value by the resolution, at a variance of the noise of one sample.

        Noise of about half a step or more moves the samples from step to step, so that their mean is not
        rounded (the error of the mean falls with the exponential of the squared noise). The noise of a signal
        that never changed is not known, unless it is declared.
        """
        step = self._resolution
        if np.isnan(step):
            return np.full(len(of_sample), np.nan if self._record.std == 0.0 else 0.0)
        if step == 0.0:
            return np.zeros(len(of_sample))
        return step**2 / 12.0 * np.exp(-4.0 * np.pi**2 * of_sample / step**2)
