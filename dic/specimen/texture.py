"""Local texture of an image, computed at a reduced resolution.

The texture is described by the structure tensor: the means of fx², fx fy and fy² over a window, where fx
and fy are the slopes of the grey levels. The smaller eigenvalue of this tensor is large only if the grey
levels change in every direction, so a window with one straight edge has a small value (J. Bigün, G. H.
Granlund, "Optimal orientation detection of linear symmetry", International Conference on Computer Vision
1987, 433-438).

Half of the resolution is enough, because speckles that can be measured are at least 3 px wide. The smoothing
before the reduction also removes most of the noise. For coarser speckles the resolution is reduced further:
the best scale is the one at which the slopes per pixel are largest (T. Lindeberg, "Feature detection with
automatic scale selection", International Journal of Computer Vision 30 (1998) 79-116).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple, Protocol

import numpy as np

from dic.image.threads import bands_of
from dic.typing import Float, Grey, Mask

# Taps of `cv2.pyrDown` along each axis, and of the Sobel filter along and across the slope.
_REDUCTION = np.array([1.0, 4.0, 6.0, 4.0, 1.0]) / 16.0
_SLOPE, _ACROSS = np.array([-0.5, 0.0, 0.5]), np.array([0.25, 0.5, 0.25])

NARROWEST, _WIDEST = 7, 13
"""Limits of the window's width, in reduced pixels; wider windows would blur the outline of the specimen."""

_ABOVE_NOISE = 3.0
"""A window has texture if its smaller eigenvalue exceeds that of white noise by this factor.

White noise alone gives multiples around 1, with a largest value of 2.1 in windows of 11 px. Blobs of 0.6 px
(standard deviation), the finest blobs that may be measurable, give 8.
"""

_BAND_PX = 256
"""Height of the bands of rows in which eigenvalues are computed, reduced pixels."""

EVERY_DIRECTION = 0.12
"""Least ratio of the eigenvalues. Speckles seen at 70° have 0.12; streaks and straight edges have less."""


class SlopeProducts(Protocol):
    """The products of the slopes of the grey levels, at each pixel of the reduced image."""

    def of_rows(self, rows: slice) -> "SlopeProducts":
        """Return the products of some rows."""

    def weighted(self, weight: Grey) -> Iterator[Grey]:
        """Yield fx², fy² and fx fy, times a weight for each pixel."""


class Slopes(NamedTuple):
    """The slopes of the grey levels along x and y."""

    fx: Grey
    fy: Grey

    def of_rows(self, rows: slice) -> "Slopes":
        """Return the slopes of some rows."""
        return Slopes(self.fx[rows], self.fy[rows])

    def weighted(self, weight: Grey) -> Iterator[Grey]:
        """Yield fx², fy² and fx fy, times a weight for each pixel."""
        weighted_x = self.fx * weight
        yield weighted_x * self.fx
        yield self.fy * self.fy * weight
        yield weighted_x * self.fy


@dataclass(frozen=True)
class TextureMaps:
    """Maps of the texture, each an array of float32 of the size of the reduced image."""

    reduction: int
    """Number of image pixels along the side of a reduced pixel: 2, 4 or 8."""
    window: int
    """Width of the window of all means, in reduced pixels."""
    grey: Grey
    """Mean grey level."""
    slopes: SlopeProducts
    """Slopes of the grey levels, or means of their products."""
    energy: Grey
    """Squared slope fx² + fy²."""
    curvature: Grey
    """Squared Laplacian of the grey levels."""
    weakest: Grey
    strongest: Grey
    """Smaller and larger eigenvalue of the structure tensor."""
    noise: Grey
    """Part of `weakest` that white noise causes. The noise is estimated in each window, because a bright
    surface is noisier than a dark one.
    """
    spread: Grey
    """(mean |f'|)² / mean |f'|², where |f'| is the magnitude of the slope. The value is π/4 for Gaussian
    texture, and small if few pixels have strong slopes, as beside a lone edge.
    """

    @property
    def above_noise(self) -> Mask:
        """True where a window has more texture than noise causes."""
        return np.asarray(self.weakest > np.float32(_ABOVE_NOISE) * self.noise)

    @property
    def only_noise(self) -> Mask:
        """True where a window shows noise, and not even a line."""
        return np.asarray(self.strongest <= np.float32(_ABOVE_NOISE) * self.noise)

    @property
    def in_every_direction(self) -> Mask:
        """True where the grey levels of a window change in every direction."""
        return np.asarray(self.weakest > np.float32(EVERY_DIRECTION) * self.strongest)


def texture_maps(grey: Grey, subset_px: int) -> TextureMaps:
    """Return the texture of an image at the resolution at which it is strongest.

    `subset_px`: width of the subsets. Windows are not wider than a subset.
    """
    import cv2

    ripples, small = np.square(diagonal_difference(grey)), np.asarray(cv2.pyrDown(grey), np.float32)
    maps, reduction = maps_at(small, ripples, subset_px, 2), 2
    while subset_px // (2 * reduction) >= NARROWEST:
        small, reduction = np.asarray(cv2.pyrDown(small), np.float32), 2 * reduction
        coarser = maps_at(small, ripples, subset_px, reduction)
        if strength(coarser) <= strength(maps):
            break
        maps = coarser
    return maps


def eigenvalues(xx: Grey, yy: Grey, xy: Grey) -> tuple[Grey, Grey]:
    """Return the smaller and the larger eigenvalue of the matrices [[xx, xy], [xy, yy]]."""
    smaller, larger = np.empty_like(xx), np.empty_like(xx)
    # The intermediate results of a whole map would take twice the memory of the three maps.
    for band in bands_of(len(xx), _BAND_PX):
        a, b, c = xx[band], yy[band], xy[band]
        total, difference = a + b, np.sqrt(np.square(a - b) + np.float32(4.0) * np.square(c))
        np.multiply(np.float32(0.5), total - difference, out=smaller[band])
        np.multiply(np.float32(0.5), total + difference, out=larger[band])
    return smaller, larger


def strength(maps: TextureMaps) -> float:
    """Return the `usable_strength` that 10 % of all windows exceed."""
    return float(np.percentile(usable_strength(maps), 90))


def usable_strength(maps: TextureMaps) -> Grey:
    """Return the smaller eigenvalue of every other window along x and y; 0 without usable texture."""
    every_other = (slice(None, None, 2), slice(None, None, 2))
    good = (maps.above_noise & maps.in_every_direction)[every_other]
    return np.where(good, maps.weakest[every_other], np.float32(0.0))


def maps_at(small: Grey, ripples: Grey, subset_px: int, reduction: int) -> TextureMaps:
    """Return the texture of the image `small`, which has been reduced by `reduction`.

    The pixels of `ripples` are estimates of the variance of the full image's noise.
    """
    import cv2

    window = window_at(subset_px, reduction)

    def mean(of: Grey) -> Grey:
        return np.asarray(cv2.blur(of, (window, window)), np.float32)

    fx = np.asarray(cv2.Sobel(small, cv2.CV_32F, 1, 0, ksize=3, scale=0.125), np.float32)
    fy = np.asarray(cv2.Sobel(small, cv2.CV_32F, 0, 1, ksize=3, scale=0.125), np.float32)
    squares_x, squares_y = fx * fx, fy * fy
    energy = squares_x + squares_y
    weakest, strongest = eigenvalues(mean(squares_x), mean(squares_y), mean(fx * fy))
    magnitude = mean(np.sqrt(energy))
    if ripples.shape != small.shape:
        ripples = np.asarray(cv2.resize(ripples, small.shape[::-1], interpolation=cv2.INTER_AREA), np.float32)
    return TextureMaps(
        reduction=reduction,
        window=window,
        grey=mean(small),
        slopes=Slopes(fx, fy),
        energy=energy,
        curvature=np.square(np.asarray(cv2.Laplacian(small, cv2.CV_32F), np.float32)),
        weakest=weakest,
        strongest=strongest,
        noise=np.float32(slope_gain(reduction)) * mean(ripples),
        spread=magnitude * magnitude / np.maximum(weakest + strongest, np.float32(1e-30)),
    )


def window_at(subset_px: int, reduction: int) -> int:
    """Return the width of the window of all means in an image that is reduced by `reduction`, px."""
    return min(max(subset_px // reduction | 1, NARROWEST), _WIDEST)


@cache
def slope_gain(reduction: int) -> float:
    """Return the variance of a slope after the reduction, if the pixels have white noise of variance 1."""
    taps, spacing = np.ones(1), 1
    while spacing < reduction:
        taps, spacing = np.convolve(taps, _spaced(_REDUCTION, spacing)), 2 * spacing
    along, across = (np.convolve(taps, _spaced(own, reduction)) for own in (_SLOPE, _ACROSS))
    return float(np.sum(along**2) * np.sum(across**2))


def _spaced(taps: Float, spacing: int) -> Float:
    """Return the taps of a filter whose neighbours are `spacing` px apart."""
    spaced = np.zeros(spacing * (len(taps) - 1) + 1)
    spaced[::spacing] = taps
    return spaced


def diagonal_difference(grey: Grey) -> Grey:
    """Return (a - b - c + d) / 2 for each square of four pixels a b / c d; white noise keeps its variance."""
    rows, columns = (size // 2 * 2 for size in grey.shape)
    above = grey[0:rows:2, 0:columns:2] - grey[0:rows:2, 1:columns:2]
    below = grey[1:rows:2, 0:columns:2] - grey[1:rows:2, 1:columns:2]
    return np.asarray(np.float32(0.5) * (above - below), np.float32)
