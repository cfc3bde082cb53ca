"""The power spectrum of a speckle pattern, estimated from tiles of an image."""

from dataclasses import dataclass

import numpy as np

from dic.image.fourier import fft2
from dic.typing import Float, Grey, Mask

_TILE_PX = 64
_SMALLEST_TILE_PX = 16
_TILES = 25
"""Largest number of tiles of an image whose spectra are averaged."""

_LEAST_SHARE = 0.9
"""Smallest share of a tile's pixels that must lie in the region of interest."""

_CORNER = 0.8
"""Above this share of the Nyquist frequency, along x and along y, the pattern has hardly any power."""


@dataclass(frozen=True)
class PatternSpectrum:
    """The power spectrum of the grey levels."""

    power: Float
    """Shape (n + 1, n + 1). Power at the angular frequencies `frequencies`; the first axis is y. The mean
    over both signs of the frequency has been taken. The mean of the power over all frequencies is the
    variance of the grey levels, so the power of white noise equals its variance at every frequency.
    """

    @property
    def frequencies(self) -> Float:
        """Angular frequencies along an axis, shape (n + 1,), from 0 to π rad/px."""
        return np.linspace(0.0, np.pi, len(self.power))

    @property
    def counts(self) -> Float:
        """Number of positive and negative frequencies in each element of `power`, shape (n + 1, n + 1)."""
        along = np.full(len(self.power), 2.0)
        along[[0, -1]] = 1.0
        return np.outer(along, along)

    @property
    def corner(self) -> float:
        """Mean power at the highest frequencies along both axes: an upper bound of the noise's variance."""
        high = self.frequencies >= _CORNER * np.pi
        return float(self.power[np.ix_(high, high)].mean())

    def without(self, noise_variance: float) -> "PatternSpectrum":
        """Return the spectrum without white noise of the given variance.

        The power of a few tiles scatters, so some elements become negative. Negative elements must not be
        limited to 0, because sums over many elements would then become too large.
        """
        return PatternSpectrum(self.power - noise_variance)


def pattern_spectrum(grey: Grey, region: Mask) -> PatternSpectrum | None:
    """Return the mean power spectrum of tiles that lie in the region; None if no tile fits in the region.

    Each tile is multiplied by a Hann window (P. D. Welch, IEEE Transactions on Audio and Electroacoustics 15
    (1967) 70-73). Tiles are 64 px wide, or 32 or 16 px in a narrow region.

    `grey`: shape (height, width). `region`: shape (height, width).
    """
    tile_px = _TILE_PX
    while tile_px >= _SMALLEST_TILE_PX:
        tiles = _tiles(grey, region, tile_px)
        if tiles:
            return _mean_power(np.stack(tiles))
        tile_px //= 2
    return None


def _tiles(grey: Grey, region: Mask, tile_px: int) -> list[Grey]:
    """Return at most 25 tiles of the image that lie in the region, spread evenly."""
    # Tiles start at multiples of half their width. Every fourth pixel is enough to estimate which share of a
    # tile lies in the region.
    half = tile_px // 2
    rows, columns = (size // half for size in region.shape)
    if min(rows, columns) < 2:
        return []
    sample = region[: rows * half : 4, : columns * half : 4]
    share = sample.reshape(rows, half // 4, columns, half // 4).mean(axis=(1, 3))
    covered = (share[:-1, :-1] + share[1:, :-1] + share[:-1, 1:] + share[1:, 1:]) / 4
    found = np.argwhere(covered >= _LEAST_SHARE) * half
    chosen = found[:: max(1, -(-len(found) // _TILES))]
    return [grey[y : y + tile_px, x : x + tile_px].astype(np.float32) for y, x in chosen]


def _mean_power(tiles: Grey) -> PatternSpectrum:
    size = tiles.shape[-1]
    along = np.sin(np.pi * np.arange(size) / size) ** 2
    window = np.outer(along, along).astype(np.float32)
    level = np.einsum("nij,ij->n", tiles, window) / window.sum()
    waves = fft2((tiles - level[:, None, None].astype(np.float32)) * window)
    power = np.square(np.abs(waves)).mean(axis=0, dtype=np.float64) / float(np.square(window).sum())
    half = np.arange(size // 2 + 1)
    return PatternSpectrum((power[np.ix_(half, half)] + power[np.ix_(half, -half)]) / 2)
