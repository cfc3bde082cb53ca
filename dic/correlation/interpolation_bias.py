"""The bias of displacements that interpolation causes, predicted from the spectrum of the pattern.

The deformed image is known at the pixels only, and is interpolated between them. Interpolation changes each
wave of the pattern a little, and the change depends on the sub-pixel part of the displacement. For a wave of
angular frequency ω in an image that is displaced by τ, the interpolated image at the true place is the wave
times E(ω, τ) = Σₙ φ(ω + 2πn) exp(2πinτ), where φ is the transfer function of the interpolation, and the sum
is over all integers n. The terms with n ≠ 0 are replicas (shifted copies) of the spectrum, which perfect
interpolation would remove.

The correlation (IC-GN) finds the displacement at which the sum of slope × (interpolated image - reference) is
0. To first order, the error of the displacement is therefore

    b(τ) = - ∑ S D Im E / ∑ S D E'

where the sums are over all waves of the pattern, S is the power of a wave, D is the factor of the reference's
slope (nearly ω), and E' = Σₙ (ω + 2πn) φ(ω + 2πn) cos(2πnτ) is the slope of the interpolated image. So the
phase error of each frequency is weighted with the energy of its gradient. The terms n = ±1 dominate, so b(τ)
is nearly b(1/4) sin(2πτ). H. W. Schreier, J. R. Braasch, M. A. Sutton, "Systematic errors in digital image
correlation caused by intensity interpolation", Optical Engineering 39 (2000) 2915-2921; Y. Su, Q. Zhang, Z.
Gao, X. Xu, X. Wu, "Fourier-based interpolation bias prediction in digital image correlation", Optics Express
23 (2015) 19242-19260. The bias of u is averaged over all sub-pixel parts of v, and the bias of v over all
sub-pixel parts of u.

The same formula is valid for aliased waves (`dic.correlation.aliasing`): a camera records a wave above the
Nyquist frequency as a wave of lower frequency. In the formula, ω is then the true frequency of the aliased
wave, which is above π, while D belongs to the recorded wave. The recorded wave moves in the wrong direction,
so the bias of an aliased wave has the opposite sign.
"""

from functools import cache

import numpy as np

from dic.correlation.pattern_spectrum import PatternSpectrum
from dic.correlation.transfer import COPIES, filter_transfer, interpolation_transfer, slope_transfer
from dic.typing import Float

Replica = tuple[int, int]
"""A replica, given by two whole numbers: its shift in sampling frequencies 2π, along y and along x."""

_SMALL = 0.01

_PHASE_PX = 0.25
"""Sub-pixel displacement at which the bias is greatest."""


def greatest_bias(
    spectrum: PatternSpectrum,
    order: int,
    smoothing: tuple[float, ...] = (1.0,),
    shares: dict[Replica, Float] | None = None,
) -> tuple[float, float]:
    """Return the greatest bias of u and of v, px, which occurs at a sub-pixel displacement of 1/4 px.

    `spectrum`: the spectrum of the pattern, without noise. `order`: degree of the interpolating B-spline, 3
    or 5. `smoothing`: taps of the filter that smooths both images along x and along y before interpolation.
    `shares`: share of the power that belongs to each replica, shape (n + 1, n + 1). The default assumes that
    the camera has not aliased the pattern: all power belongs to the recorded frequencies.
    """
    passed = filter_transfer(spectrum.frequencies, smoothing) ** 2
    power = spectrum.power * spectrum.counts * np.outer(passed, passed)
    errors, slopes = np.zeros(2), np.zeros(2)
    for replica, share in (shares or {(0, 0): np.ones_like(power)}).items():
        for axis in (0, 1):
            # The weights are those for motion along x; transpose the power for motion along y.
            along = (power * share) if axis == 0 else (power * share).T
            error, slope = _weights(len(power), order, replica if axis == 0 else replica[::-1])
            errors[axis] += np.sum(along * error)
            slopes[axis] += np.sum(along * slope)
    u, v = np.divide(-errors, slopes, out=np.zeros(2), where=slopes > 0.0)
    return float(u), float(v)


@cache
def _weights(size: int, order: int, replica: Replica) -> tuple[Float, Float]:
    """Return D Im E and D E' at all frequencies of a spectrum of the given size, for motion along x."""
    frequency = np.linspace(0.0, np.pi, size)
    across, along = (frequency + 2 * np.pi * n for n in replica)
    n = np.arange(-COPIES, COPIES + 1)
    at = along[:, None] + 2 * np.pi * n
    passed = interpolation_transfer(at, order)
    error = passed @ np.sin(2 * np.pi * n * _PHASE_PX)
    slope = (passed * at) @ np.cos(2 * np.pi * n * _PHASE_PX)
    mean_across = interpolation_transfer(across, order)
    recorded = slope_transfer(frequency, order)
    return np.outer(mean_across, recorded * error), np.outer(mean_across, recorded * slope)


def bias_at(displacement_px: Float, gradient: Float, subset_px: int, greatest_px: float) -> Float:
    """Return the predicted bias of displacements from their sub-pixel part, px.

    A displacement gradient gives the pixels of a subset different sub-pixel parts, so the bias is averaged
    over the subset.

    `displacement_px`, shape (…): displacements along one axis. `gradient`, shape (…, 2): derivatives of these
    displacements along x and y. `subset_px`: width of the subset. `greatest_px`: bias at a sub-pixel part of
    1/4 px.
    """
    averaged = np.sinc(subset_px * gradient[..., 0]) * np.sinc(subset_px * gradient[..., 1])
    return np.asarray(greatest_px * np.sin(2 * np.pi * displacement_px) * averaged)


def slope_bias_at(displacement_px: Float, gradient: Float, subset_px: int, greatest_px: float) -> Float:
    """Return the predicted bias of the displacement gradient of a subset, shape (…, 2).

    The arguments are those of `bias_at`. A displacement gradient changes the sub-pixel part within the
    subset, and so it changes the bias. The shape function is fitted to this changing bias: see
    `fitted_slope`.
    """
    half = subset_px / 2
    x, y = gradient[..., 0], gradient[..., 1]
    slopes = [
        fitted_slope(2 * np.pi * along, half) * np.sinc(subset_px * across)
        for along, across in ((x, y), (y, x))
    ]
    return greatest_px * np.cos(2 * np.pi * displacement_px)[..., None] * np.stack(slopes, axis=-1)


def fitted_slope(frequency: Float, half_px: float) -> Float:
    """Return the slope at 0 of the line that fits sin(ωx) best between -half_px and half_px.

    The slope is 3 j₁(ωh) / h, where h is `half_px` and j₁(x) = (sin(x)/x - cos(x)) / x is the spherical
    Bessel function.
    """
    at = np.asarray(frequency) * half_px
    near = np.abs(at) < _SMALL
    # Near 0, the difference of nearly equal numbers loses digits, so take the first terms of the power
    # series.
    safe = np.where(near, 1.0, at)
    bessel = np.where(near, at / 3 - at**3 / 30, (np.sin(safe) / safe - np.cos(safe)) / safe)
    return np.asarray(bessel * 3 / half_px)


def strain_error(greatest_px: float, gauge_px: float, subset_px: int, strain_range: float) -> float:
    """Return the greatest error of a local strain that the bias of displacements causes.

    In a uniform strain ε the displacement changes along x, so its bias is the wave b sin(2πεx). The subset
    averages the bias to b sinc(εn), where n is the width of the subset. The local strain is the slope of the
    line that fits this wave best (`fitted_slope`). The function returns the greatest slope for strains up to
    `strain_range`.

    `greatest_px`: bias at a sub-pixel part of 1/4 px. `gauge_px`: width of the virtual strain gauge. Points
    lie in the gauge's middle part, of width `gauge_px` minus `subset_px`. `strain_range`: largest strain of
    the experiment.
    """
    strain = np.linspace(0.0, strain_range, 400)
    slope = fitted_slope(2 * np.pi * strain, (gauge_px - subset_px) / 2) * np.sinc(strain * subset_px)
    return float(abs(greatest_px) * np.abs(slope).max())
