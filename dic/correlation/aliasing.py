"""Aliasing: the share of a spectrum that comes from waves above the Nyquist frequency.

A random speckle pattern has the same spectrum in all directions. A camera records waves along the pixel rows
together with aliased waves of the same frequency. The camera records diagonal waves without aliased waves,
because the diagonals of the pixel grid have a higher Nyquist frequency. So the difference between rows and
diagonals gives the aliased share of the recorded power.

At the wave number k, the model of the pattern's power is A k⁻ᵖ exp(-s²k²) times the transfer function of a
square pixel, sinc²(ωx/2π) sinc²(ωy/2π). A pattern with sharp edges has p = 3; the exponential factor
describes the blur of the lens and the shape of round blobs. Sampling shifts the spectrum by multiples of the
sampling frequency; each shifted copy is a replica. The model of the recorded power is the sum of all
replicas, plus white noise. The fit chooses the parameters with the greatest likelihood (P. Whittle, Arkiv för
Matematik 2 (1953) 423-434).
"""

import numpy as np

from dic.correlation.interpolation_bias import Replica
from dic.correlation.pattern_spectrum import PatternSpectrum
from dic.typing import Float

_REPLICAS: tuple[Replica, ...] = tuple((down, right) for down in (-1, 0, 1) for right in (-1, 0, 1))
_LOWEST = 0.45
"""The fit ignores frequencies below this share of the Nyquist frequency; they depend on the speckle size."""

_STEPS = 4
_POWERS = np.arange(0.0, 4.5, 0.5)
_WIDTHS = np.concatenate([np.linspace(0.0, 0.3, 7), np.linspace(0.4, 3.0, 14)])
_LEAST_POWER = 1e-9


def replica_shares(
    spectrum: PatternSpectrum, noise_variance: float, *, noise_known: bool
) -> tuple[dict[Replica, Float], float]:
    """Return the share of each replica in the recorded power, and the variance of the noise.

    `spectrum`: the recorded spectrum, with its noise. `noise_variance`: variance of the white noise.
    `noise_known`: True if `noise_variance` is known, from two images. False if `noise_variance` is only an
    upper bound. The fit then determines the variance.

    Result: one array of shape (n + 1, n + 1) for each replica: the replica's share of the power at each
    frequency. The sum of all arrays is the pattern's share, and the rest of the power is noise.
    """
    frequency = spectrum.frequencies
    radius = np.hypot(frequency[:, None], frequency)
    fitted = radius > _LOWEST * np.pi
    recorded = np.maximum(spectrum.power[fitted], _LEAST_POWER * max(float(spectrum.power.max()), 1e-300))
    distance, pixel = _replicas(frequency)
    least = noise_variance if noise_known else 0.0
    best, shares, noise = np.inf, np.zeros_like(distance), noise_variance
    for power in _POWERS:
        sharp = pixel * distance**-power
        for width in _WIDTHS:
            model = sharp * np.exp(-width * np.pi**2 * (distance**2 - 1.0))
            scale, found = _scaled(model.sum(axis=0)[fitted], recorded, (least, noise_variance))
            total = scale * model.sum(axis=0) + found
            misfit = float(np.mean(np.log(total[fitted]) + recorded / total[fitted]))
            if misfit < best:
                best, shares, noise = misfit, scale * model / total, found
    return dict(zip(_REPLICAS, shares, strict=True)), noise


def _replicas(frequency: Float) -> tuple[Float, Float]:
    """Return for each replica the true frequency, in π rad/px, and the power transfer of a square pixel."""
    distances, pixels = [], []
    for down, right in _REPLICAS:
        y, x = frequency[:, None] / np.pi + 2 * down, frequency / np.pi + 2 * right
        distances.append(np.maximum(np.hypot(y, x), 1e-3))
        pixels.append((np.sinc(x / 2) * np.sinc(y / 2)) ** 2)
    return np.stack(distances), np.stack(pixels)


def _scaled(model: Float, recorded: Float, bounds: tuple[float, float]) -> tuple[float, float]:
    """Return the scale of a model and the variance of the noise that fit the recorded power best.

    The variance lies between `bounds`. The fit minimises the squared relative deviations by iteration. Each
    iteration takes its weights from the model that the previous iteration fitted.
    """
    weight = 1.0 / recorded**2
    scale, noise = 0.0, bounds[1]
    for _ in range(_STEPS):
        a, b, c = weight @ (model * model), weight @ model, weight.sum()
        p, q = weight @ (model * recorded), weight @ recorded
        determinant = a * c - b * b
        free = (a * q - b * p) / determinant if determinant > 0.0 else bounds[1]
        noise = float(np.clip(free, *bounds))
        scale = max(float((p - b * noise) / a), _LEAST_POWER)
        weight = 1.0 / (scale * model + noise) ** 2
    return scale, noise
