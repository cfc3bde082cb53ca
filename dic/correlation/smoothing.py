"""Smooth both images before the correlation, so that interpolation causes less bias.

Sharp speckles contain waves close to the Nyquist frequency, which no interpolation represents well. A
Gaussian filter weakens these waves in both images alike, so the displacement does not change.
`chosen_smoothing` takes the narrowest Gaussian that is enough for the pattern.

After the filter, the noise of neighbouring pixels is correlated. The displacement of a subset is a weighted
sum of the noise; the weights are the slopes of the pattern. To find the variance of the displacement, take
the variance that white noise of the same strength would cause, and multiply it by

    ∑ S G² D² G² / (∑ S G² D² · mean(G²)),

where the sums and the mean are over all waves, G is the filter's transfer function, S G² the power of the
smoothed pattern, D the factor of the slope, and G² / mean(G²) the power of the noise relative to white noise.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dic.correlation.interpolation_bias import greatest_bias
from dic.correlation.pattern_spectrum import PatternSpectrum, pattern_spectrum
from dic.correlation.settings import AUTO, CorrelationSettings
from dic.correlation.transfer import filter_transfer, slope_transfer
from dic.image.stored import StoredImage, is_large
from dic.typing import Grey, Mask

LARGEST_BIAS_PX = 0.001
"""Largest predicted bias for which images are not smoothed; `chosen_smoothing` stays below this value."""

_WIDTHS_PX = np.arange(0.3, 2.01, 0.05)
_EFFECT = 2.5
"""Beyond this multiple of the standard deviation, the weights of a Gaussian add up to 1 %."""

_REACH = 4.0
"""The Gaussian is cut off at this multiple of its standard deviation."""


@dataclass(frozen=True)
class Smoothing:
    """A Gaussian filter for both images of a correlation, and its effects."""

    width_px: float = 0.0
    """Standard deviation of the Gaussian; 0 means that images are not smoothed."""
    bias_px: tuple[float, float] = (0.0, 0.0)
    """Predicted greatest interpolation bias of u and of v in the smoothed images."""
    std_factors: tuple[float, float] = (1.0, 1.0)
    """Factors by which the correlation of neighbouring pixels' noise changes the standard deviations of u and
    of v.
    """

    @property
    def taps(self) -> tuple[float, ...]:
        """Weights of the pixels along x and along y."""
        return gaussian_taps(self.width_px)

    @property
    def reach_px(self) -> int:
        """Distance over which a pixel influences the smoothed image noticeably, px."""
        return int(np.ceil(_EFFECT * self.width_px))

    @property
    def noise_factor(self) -> float:
        """Factor by which the filter changes the standard deviation of white noise."""
        return float(np.sum(np.square(self.taps)))

    def applied(self, grey: NDArray[Any]) -> StoredImage:
        """Return an image that is smoothed: a large image when its rows are used, a small image at once.

        `grey`, shape (height, width): grey levels as `dic.image.given.grey_levels` returns them.
        """
        return StoredImage(grey, self.taps) if is_large(grey.shape) else StoredImage(self.apply(grey))

    def apply(self, grey: Grey) -> Grey:
        """Return the smoothed image."""
        import cv2

        if self.width_px == 0.0:
            return grey
        taps = np.array(self.taps, np.float32)
        smoothed = cv2.sepFilter2D(grey, cv2.CV_32F, taps, taps, borderType=cv2.BORDER_REFLECT_101)
        return np.asarray(smoothed, np.float32)


NO_SMOOTHING = Smoothing()


def gaussian_taps(width_px: float) -> tuple[float, ...]:
    """Return the weights of a Gaussian filter of the given standard deviation; the weights' sum is 1."""
    if width_px == 0.0:
        return (1.0,)
    reach = int(np.ceil(_REACH * width_px))
    weights = np.exp(-0.5 * np.square(np.arange(-reach, reach + 1) / width_px))
    return tuple((weights / weights.sum()).tolist())


def chosen_smoothing(grey: Grey, region: Mask, settings: CorrelationSettings) -> Smoothing:
    """Return the smoothing that the settings ask for, with its predicted effects.

    With the setting "auto" the result is the narrowest Gaussian for which the predicted bias of u and of v is
    at most 0.001 px. The prediction assumes that the camera has not aliased the pattern, because aliased
    waves would mostly reduce the bias. The highest frequencies along both axes count as noise.

    `grey`, shape (height, width): the reference image. `region`, shape (height, width): the region that is
    measured.
    """
    spectrum = pattern_spectrum(grey, region)
    if spectrum is None:
        # The region is too narrow to judge its pattern.
        return Smoothing(0.0 if settings.smoothing_px == AUTO else float(settings.smoothing_px))
    pattern = spectrum.without(spectrum.corner)
    if settings.smoothing_px != AUTO:
        return _smoothing(pattern, settings.order, float(settings.smoothing_px))
    chosen = _smoothing(pattern, settings.order, 0.0)
    for width_px in _WIDTHS_PX:
        if max(map(abs, chosen.bias_px)) <= LARGEST_BIAS_PX:
            break
        chosen = _smoothing(pattern, settings.order, round(float(width_px), 2))
    return chosen


def _smoothing(pattern: PatternSpectrum, order: int, width_px: float) -> Smoothing:
    taps = gaussian_taps(width_px)
    bias_px = greatest_bias(pattern, order, taps)
    factors = (1.0, 1.0) if width_px == 0.0 else _std_factors(pattern, order, taps)
    return Smoothing(width_px, bias_px, factors)


def _std_factors(pattern: PatternSpectrum, order: int, taps: tuple[float, ...]) -> tuple[float, float]:
    passed = filter_transfer(pattern.frequencies, taps) ** 2
    slope = slope_transfer(pattern.frequencies, order) ** 2
    noise = np.outer(passed, passed) / np.sum(np.square(taps)) ** 2
    power = pattern.power * pattern.counts * np.outer(passed, passed)
    greatest = float(noise.max())
    squares = []
    for energy in (power * slope, power * slope[:, None]):
        total, smoothed = float(energy.sum()), float((energy * noise).sum())
        # If noise hides the pattern, the sums can be negative. Then only the upper bound `greatest` is known.
        known = total > 0.0 and smoothed > 0.0
        squares.append(min(smoothed / total, greatest) if known else greatest)
    return float(np.sqrt(squares[0])), float(np.sqrt(squares[1]))
