"""The interpolation bias that the pattern of an image causes, and the smoothing against this bias."""

from dataclasses import dataclass

import numpy as np

from dic.correlation.aliasing import replica_shares
from dic.correlation.interpolation_bias import greatest_bias, strain_error
from dic.correlation.pattern_spectrum import pattern_spectrum
from dic.correlation.settings import CorrelationSettings
from dic.correlation.smoothing import Smoothing, chosen_smoothing
from dic.typing import Grey, Mask

_WINDOW_POINTS = 3
"""Width of the strain window for which the error of the strain is stated, in points."""

_UNKNOWN = (float("nan"), float("nan"))


@dataclass(frozen=True)
class InterpolationBias:
    """Predicted errors of interpolation."""

    bias_px: tuple[float, float]
    """Greatest bias of u and of v over all sub-pixel displacements, without smoothing; NaN if the region is
    too narrow. The bias contains the effect of waves that the camera has aliased. A positive bias draws
    displacements of 1/4 px towards 1/2 px.
    """
    unaliased_bias_px: tuple[float, float]
    """The greatest bias that would result if the camera had not aliased the pattern."""
    smoothing: Smoothing
    """The smoothing that the correlation will apply, and the bias that it leaves."""
    strain_range: float
    """Largest strain of the experiment."""
    gauge_px: int
    """Width of the virtual strain gauge for which the strain error is stated."""
    subset_px: int
    """Width of the subsets."""

    @property
    def greatest_px(self) -> float:
        """The larger of the biases of u and of v without smoothing, as an absolute value."""
        return float(np.abs(self.bias_px).max())

    @property
    def left_px(self) -> float:
        """Greatest bias, as an absolute value, that remains after the smoothing that will be applied."""
        if self.smoothing.width_px == 0.0:
            return self.greatest_px
        return float(np.abs(self.smoothing.bias_px).max())

    def figures(self) -> dict[str, float]:
        """Return a dict of the values that `docs/quality.md` explains; an unknown value is NaN."""
        return {
            "bias_u_px": self.bias_px[0],
            "bias_v_px": self.bias_px[1],
            "unaliased_bias_u_px": self.unaliased_bias_px[0],
            "unaliased_bias_v_px": self.unaliased_bias_px[1],
            "bias_strain": self._strain_error(self.greatest_px),
            "smoothing_px": self.smoothing.width_px,
            "left_bias_px": self.left_px,
            "left_bias_strain": self._strain_error(self.left_px),
            "strain_range": self.strain_range,
            "gauge_px": float(self.gauge_px),
        }

    def _strain_error(self, bias_px: float) -> float:
        return strain_error(bias_px, self.gauge_px, self.subset_px, self.strain_range)


def assess_interpolation(
    grey: Grey,
    region: Mask,
    noise: float,
    settings: CorrelationSettings,
    *,
    noise_known: bool,
    strain_range: float,
) -> InterpolationBias:
    """Return the predicted errors of interpolation.

    Parameters
    ----------
    grey : ndarray, shape (height, width)
    region : ndarray of bool, shape (height, width)
        Pixels that subsets use.
    noise : float
        Standard deviation of the noise, grey levels.
    settings : CorrelationSettings
        The function uses the order of the spline, the smoothing, the subset and the step.
    noise_known : bool
        True if the noise was measured from two images. The noise of one image is only an upper bound if its
        speckles are sharp.
    strain_range : float
        Largest strain of the experiment.
    """
    gauge_px = (_WINDOW_POINTS - 1) * settings.step_px + settings.subset_px
    bias_px, unaliased_px = _UNKNOWN, _UNKNOWN
    spectrum = pattern_spectrum(grey, region)
    if spectrum is not None:
        shares, noise_variance = replica_shares(spectrum, noise**2, noise_known=noise_known)
        bias_px = greatest_bias(spectrum, settings.order, shares=shares)
        unaliased_px = greatest_bias(spectrum.without(noise_variance), settings.order)
    smoothing = chosen_smoothing(grey, region, settings)
    return InterpolationBias(bias_px, unaliased_px, smoothing, strain_range, gauge_px, settings.subset_px)
