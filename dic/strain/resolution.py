"""The share of a varying strain that the settings keep, and the share that the settings remove.

Correlation with subsets and the fit of strain windows are smoothing filters. The transfer functions of these
filters follow from the polynomials that are fitted (A. Savitzky, M. J. E. Golay, Analytical Chemistry 36
(1964) 1627-1639). The wave numbers of the strain follow from the measured field itself, after its noise is
subtracted. The same filters determine the spectrum of this noise.
"""

import math
from dataclasses import dataclass
from functools import cache

import numpy as np

from dic.correlation.settings import CorrelationSettings
from dic.image.threads import bands_of
from dic.strain.root import root
from dic.strain.settings import StrainSettings
from dic.typing import Float, Mask

_LARGEST_LOSS = 0.6
"""Largest loss of amplitude that is stated; a larger loss leaves too little strain to estimate the loss."""
_SIGNIFICANT = 3.0
"""A loss is estimated if the strain's mean square exceeds the noise's by this many standard deviations."""

_PHASES = np.linspace(0.0, math.pi, 1000)
"""Phase differences of neighbouring points for which the transfer functions are tabulated, radians."""

_POINTS = 250_000
"""Approximate number of points whose loss of amplitude is estimated at a time."""


@dataclass(frozen=True)
class Filters:
    """The transfer functions of local strain for one combination of settings."""

    correlation: CorrelationSettings
    strain: StrainSettings

    def along(self, per_px: Float) -> Float:
        """Return the share of its amplitude that a strain wave along the direction of the derivative keeps.

        `per_px`: angular wave numbers, radians per px.
        """
        if self.strain.source == "shape":
            return _slope(per_px, self._subset_px, 1)
        return self._displacement(per_px) * _slope(
            per_px, self.strain.window_points, self.correlation.step_px
        )

    def across(self, per_px: Float) -> Float:
        """Return the share of its amplitude that a strain wave across the direction of derivative keeps."""
        if self.strain.source == "shape":
            return _mean(per_px, self._subset_px, 1)
        # Across this direction, a fitted plane and a fitted quadratic surface give all rows the same weight.
        return self._displacement(per_px) * _mean(per_px, self.strain.window_points, self.correlation.step_px)

    def resolution_px(self, share: float = 0.9) -> float:
        """Return the period, px, of the strain wave that keeps the fraction `share` of its amplitude."""
        gauge_px = self.strain.gauge_px(self.correlation)

        def excess(period_px: float) -> float:
            return float(self.along(np.array([2 * math.pi / period_px]))[0]) - share

        return root(excess, 0.5 * gauge_px, 50.0 * gauge_px)

    def noise_correlation(self, *, along: bool) -> Float:
        """Return the noise correlation of strains that are 0, 1, 2 … steps apart, up to the gauge's width."""
        step_px = self.correlation.step_px
        steps = np.arange(math.ceil(self.strain.gauge_px(self.correlation) / step_px) + 1)
        per_px = np.linspace(0.0, math.pi, 4001)
        kept = self.along(per_px) * per_px if along else self.across(per_px)
        density = kept * kept
        correlation: Float = np.cos(np.multiply.outer(steps * step_px, per_px)) @ density / density.sum()
        return correlation

    @property
    def _subset_px(self) -> int:
        return self.correlation.subset_px

    def _displacement(self, per_px: Float) -> Float:
        if self.correlation.shape == "affine":
            return _mean(per_px, self._subset_px, 1)
        offset = np.arange(self._subset_px) - self._subset_px // 2
        design = np.stack([(offset / self._subset_px) ** power for power in range(3)], axis=1)
        kept: Float = np.cos(np.multiply.outer(per_px, offset)) @ np.linalg.pinv(design)[0]
        return kept


@cache
def strain_resolution_px(correlation: CorrelationSettings, strain: StrainSettings) -> float:
    """Return the period, px, of the strain wave that keeps 90 % of its amplitude in local strain."""
    return Filters(correlation, strain).resolution_px()


def _mean(per_px: Float, points: int, step_px: int) -> Float:
    """Return the transfer function of the mean of some points."""
    offset = step_px * (np.arange(points) - points // 2)
    kept: Float = np.cos(np.multiply.outer(per_px, offset)).mean(axis=-1)
    return kept


def _slope(per_px: Float, points: int, step_px: int) -> Float:
    """Return the transfer function of the slope of a line, or of a parabola, through some points."""
    offset = step_px * (np.arange(points) - points // 2).astype(np.float64)
    phase = np.multiply.outer(per_px, offset)
    kept: Float = (offset * offset * np.sinc(phase / math.pi)).sum(axis=-1) / (offset @ offset)
    return kept


def amplitude_kept(values: Float, std: Float, filters: Filters, *, along_x: bool) -> Float:
    """Return the share of a strain's amplitude that the settings have kept, at every point.

    Around each point, the strain is treated as a wave along x and a wave along y. The phase difference of
    neighbouring points gives the wave number, and the wave number gives the share. The cosine of the phase
    difference is the mean product of neighbouring strains, divided by the mean square of the strain. The
    known contributions of noise are subtracted from both means.

    `values`, `std`, shape (rows, columns): a normal strain and its standard deviation; NaN where there is
    none. `along_x`: True for the strain exx, False for eyy.

    Result, shape (rows, columns): the share, from 0.4 to 1. The share is NaN where the strain cannot be
    distinguished from its noise.
    """
    reach = 2 * math.ceil(filters.strain.gauge_px(filters.correlation) / filters.correlation.step_px) + 1
    rows, columns = values.shape
    kept = np.empty((rows, columns))
    for band in bands_of(rows, max(2 * reach, _POINTS // max(1, columns))):
        # The additional rows on either side hold all points that decide about the rows of the band.
        above = max(0, band.start - reach)
        around = slice(above, band.stop + reach)
        found = _kept(values[around], std[around], filters, along_x, reach)
        kept[band] = found[band.start - above : band.stop - above]
    return kept


def _kept(values: Float, std: Float, filters: Filters, along_x: bool, reach: int) -> Float:
    """Return `amplitude_kept` of some rows; the mean of products is over squares of `reach` points."""
    known = np.isfinite(values) & np.isfinite(std)
    strain, variance = np.where(known, values, 0.0), np.where(known, std, 0.0) ** 2
    kept = np.ones_like(strain)
    significant = known.copy()
    noise = {along: _noise_correlation(filters, along) for along in (True, False)}
    # Noise of neighbouring values is correlated: this number of values tells as much as one independent
    # value.
    shared = math.prod(2 * float(each @ each) - 1 for each in noise.values())
    for axis, along in ((1, along_x), (0, not along_x)):
        neighbour = float(noise[along][1])
        cosine, clear = _mean_cosine(strain, variance, known, axis, reach, neighbour, shared)
        phase = np.arccos(np.clip(cosine, -1.0, 1.0))
        kept *= np.interp(phase, _PHASES, _transfer(filters, along))
        significant &= clear
    return np.where(significant, np.clip(kept, 1.0 - _LARGEST_LOSS, 1.0), np.nan)


@cache
def _noise_correlation(filters: Filters, along: bool) -> Float:
    """Return `Filters.noise_correlation`, which is the same for all images of a series."""
    return filters.noise_correlation(along=along)


@cache
def _transfer(filters: Filters, along: bool) -> Float:
    """Return the share that waves keep whose phase differs by `_PHASES` between neighbouring points."""
    return (filters.along if along else filters.across)(_PHASES / filters.correlation.step_px)


def amplitude_lost(values: Float, kept: Float) -> float:
    """Return the fraction of the strain's root mean square that the settings removed; NaN if unknown."""
    measured, true, count = 0.0, 0.0, 0
    for rows in bands_of(len(values), max(1, _POINTS // max(1, values.shape[1]))):
        known = np.isfinite(values[rows]) & np.isfinite(kept[rows])
        own = values[rows][known]
        whole = own / kept[rows][known]
        measured, true, count = measured + float(own @ own), true + float(whole @ whole), count + own.size
    return 1.0 - math.sqrt(measured / true) if count else math.nan


def _mean_cosine(
    strain: Float, variance: Float, known: Mask, axis: int, reach: int, correlation: float, shared: float
) -> tuple[Float, Mask]:
    """Return the mean cosine of the phase between neighbours, and True where the strain exceeds its noise.

    For a wave, multiply each value with the mean of its two neighbours. The mean of these products is the
    mean square of the wave times the cosine.
    """
    before, after = np.roll(strain, 1, axis), np.roll(strain, -1, axis)
    inner = known & np.roll(known, 1, axis) & np.roll(known, -1, axis)
    inner[(slice(None),) * axis + ([0, -1],)] = False
    square = _around(np.where(inner, strain * strain - variance, 0.0), reach)
    product = _around(np.where(inner, strain * (before + after) / 2 - correlation * variance, 0.0), reach)
    # The variance of the sum of the squares of n independent values with the variance σ² is 2 n σ⁴.
    scatter = np.sqrt(2 * shared * _around(np.where(inner, variance * variance, 0.0), reach))
    clear = square > _SIGNIFICANT * scatter
    return np.where(clear, product / np.where(clear, square, 1.0), 1.0), clear


def _around(values: Float, reach: int) -> Float:
    """Return the sum of the values in a square of `reach` points around each point."""
    import cv2

    # Running sums, as in cv2.boxFilter, would carry the rounding errors of a large value to all later values.
    ones = np.ones(reach)
    total: Float = cv2.sepFilter2D(values, cv2.CV_64F, ones, ones, borderType=cv2.BORDER_CONSTANT)
    return total
