"""Straight lines through the samples around given times, and robust standard deviations along a record."""

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from dic.typing import Float, Indices, Mask

_MOST_GATHERED = 1_000_000
"""Number of samples that are gathered at a time, which limits the memory."""
_MAD = 0.6744897501960817
"""Median of the absolute values of a normal distribution with a standard deviation of 1."""


@dataclass(frozen=True)
class LineFits:
    """Lines fitted to the samples around given times; all arrays have the shape of the times.

    Attributes
    ----------
    value, slope : ndarray
        Value of the line at the time, and its slope per second; NaN without a fit.
    count : ndarray of int
        Number of samples.
    residual : ndarray
        Variance of the samples about the line; NaN for fewer than three samples.
    leverage : ndarray
        Variance of the value if the samples have independent errors of variance 1.
    by_time : ndarray
        Variance of the value at a slope of 1 by the errors of the samples' times.
    """

    value: Float
    slope: Float
    count: Indices
    residual: Float
    leverage: Float
    by_time: Float


def fit_lines(
    time_s: Float, values: Float, time_std_s: Float, at_s: Float, half_s: Float, least: int
) -> LineFits:
    """Fit a line to the samples from `at_s - half_s` to `at_s + half_s`, for each time of `at_s`.

    `time_s`, shape (n,), must not fall. A time has no fit if fewer than `least` samples are around it, or all
    of them are before or after it.
    """
    first = np.searchsorted(time_s, at_s - half_s, "left")
    stop = np.searchsorted(time_s, at_s + half_s, "right")
    count = stop - first
    found = np.full((5, len(at_s)), np.nan)
    enough = np.flatnonzero(count >= least)
    # Begin with the windows that have the fewest samples, so that those of a chunk have similar numbers.
    order = enough[np.argsort(count[enough], kind="stable")]
    begin = 0
    while begin < len(order):
        # the last window of a chunk is its largest one
        rows = max(1, _MOST_GATHERED // int(count[order[min(begin + 1000, len(order)) - 1]]))
        chosen = order[begin : begin + min(rows, 1000)]
        offsets = np.arange(int(count[chosen].max()))
        inside = offsets < count[chosen][:, None]
        at = np.minimum(first[chosen][:, None] + offsets, len(time_s) - 1)
        found[:, chosen] = _fitted(time_s[at] - at_s[chosen][:, None], values[at], time_std_s[at], inside)
        begin += len(chosen)
    value, slope, residual, leverage, by_time = found
    return LineFits(value, slope, count, residual, leverage, by_time)


def _fitted(x: Float, y: Float, x_std: Float, inside: Mask) -> Float:
    """Return value at x = 0, slope, residual variance, leverage and `by_time` of each row."""
    count = inside.sum(axis=1)
    x_mean = (x * inside).sum(axis=1) / count
    # subtract a value of the row first, because large values with small changes would lose digits
    level = y[:, :1]
    y_mean = ((y - level) * inside).sum(axis=1) / count
    across, up = (x - x_mean[:, None]) * inside, (y - level - y_mean[:, None]) * inside
    spread = (across**2).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = (across * up).sum(axis=1) / spread
        weights = inside / count[:, None] - (x_mean / spread)[:, None] * across
        rest = ((up - slope[:, None] * across) ** 2).sum(axis=1) / (count - 2.0)
    both_sides = (np.where(inside, x, np.inf).min(axis=1) <= 0.0) & (
        np.where(inside, x, -np.inf).max(axis=1) >= 0.0
    )
    value = level[:, 0] + y_mean - slope * x_mean
    rows = [value, slope, rest, (weights**2).sum(axis=1), ((weights * x_std) ** 2).sum(axis=1)]
    return np.where(both_sides & (spread > 0.0), np.array(rows), np.nan)


def running_std(values: Float, near: int, least: int) -> Float:
    """Return the standard deviation of values with mean 0 around each place, from the median of their sizes.

    `near`: number of values before and after. NaN values do not count. If fewer than `least` values exist in
    all, the result is NaN.
    """
    if np.count_nonzero(np.isfinite(values)) < least:
        return np.full(len(values), np.nan)
    return _running_median(np.abs(values), near) / _MAD


def running_level(values: Float, near: int, least: int) -> Float:
    """Return the median of the values around each place; see `running_std`."""
    if np.count_nonzero(np.isfinite(values)) < least:
        return np.full(len(values), np.nan)
    return _running_median(values, near)


def _running_median(values: Float, near: int) -> Float:
    """Return running medians; those at few places of a long record stand for the places between them."""
    places = np.unique(np.linspace(0, len(values) - 1, min(len(values), 2 + 4 * len(values) // near)).round())
    padded = np.pad(values, near, constant_values=np.nan)
    windows = sliding_window_view(padded, 2 * near + 1)[places.astype(np.int64)]
    medians = np.full(len(places), np.nan)
    known = np.isfinite(windows).any(axis=1)
    medians[known] = np.nanmedian(windows[known], axis=1)
    known = np.isfinite(medians)
    return np.asarray(np.interp(np.arange(len(values)), places[known], medians[known]))
