"""Which further terms of a lens the residuals of the grid points ask for.

Real lenses have terms beyond k1, p1 and p2. Residuals that such terms leave are smooth over the image, so
they are not averaged out like noise, and the camera's parameters err by more than noise explains. So every
further term has an expected size, a prior standard deviation: one size for k2 and k3, and one for the
remainder, which are the smooth fields

    Σ c_ij x^i y^j / √(i! j!),    i + j ≥ 2

with equally probable c_ij along x and along y, where x and y are divided by half the grid's width. Their
covariance is exp(x·x') without its terms of order 0 and 1: a Gaussian process whose variance grows outwards,
as distortion does. The sizes are those with the largest evidence: the probability density of the residuals,
integrated over all parameters (MacKay, *Bayesian interpolation*, 1992). They are 0 if no size is clearly more
probable than 0.
"""

from math import factorial

import numpy as np

from dic.calibration.pinhole.lens import monomials
from dic.typing import Float

_HIGHEST = 7
_POINTS_PER_TERM = 2
"""At least so many grid points are needed for each coefficient of the remainder."""
_RADIAL_PX = 0.01 * 3.0 ** np.arange(9)
_REST_NOISES = 0.1 * 2.0 ** np.arange(12)
"""Sizes that are tried: px at the grid's edge; for the remainder in standard deviations of the noise."""
_CLEARLY = 2.0
"""A size other than 0 must have a log evidence that is larger by this for each kind of term."""


def remainder_degree(points: int) -> int:
    """Return the degree of the remainder that so many grid points determine; below 2 it has no terms."""
    degree = 1
    while degree < _HIGHEST and 2 * len(monomials(degree + 1)) * _POINTS_PER_TERM <= points:
        degree += 1
    return degree


def expected_terms(
    left_px: Float, slopes: Float, prior: tuple[Float, Float], scale_px: float, least_px: float
) -> Float:
    """Return the prior standard deviations of the scaled coefficients k2, k3 and those of the remainder.

    The result has the shape (1,) or more, up to the last coefficient whose standard deviation is not 0.

    `left_px`, shape (n,): residuals of a fit without further terms, to first order. `slopes`, shape (n, k +
    2 + terms): derivatives of the image coordinates by the k other parameters, and by the further terms.
    `prior`: the equations of `Prior` and of the grid, (m,) and (m, k). `least_px`: smallest noise.
    """
    off, by_base = prior
    count = by_base.shape[1]
    base, more = slopes[:, :count], slopes[:, count:]
    kept, _ = np.linalg.qr(np.column_stack([base, more]))
    freedom = max(len(left_px) - kept.shape[1], 1)
    noise_px = max(float(np.linalg.norm(left_px - kept @ (kept.T @ left_px))) / np.sqrt(freedom), least_px)
    whitened = np.vstack([base / noise_px, by_base])
    kept, _ = np.linalg.qr(whitened / np.linalg.norm(whitened, axis=0))
    seen = np.vstack([more / noise_px, np.zeros((len(off), more.shape[1]))])
    seen = seen - kept @ (kept.T @ seen)
    normal, side = seen.T @ seen, seen.T @ np.append(left_px / noise_px, off)
    by_k2, by_both, by_rest = _shapes(more.shape[1])
    radial = [np.zeros_like(by_k2), *(px * shape for shape in (by_k2, by_both) for px in _RADIAL_PX)]
    rest = [np.zeros_like(by_k2), *(share * noise_px * by_rest for share in _REST_NOISES if by_rest.any())]
    best = [radial[0], rest[0]]
    for k, sizes in 2 * [(0, radial), (1, rest)]:
        evidence = [
            _log_evidence(normal, side, (size + best[1 - k]) / scale_px) - _CLEARLY * size.any()
            for size in sizes
        ]
        best[k] = sizes[int(np.argmax(evidence))]
    std: Float = (best[0] + best[1]) / scale_px
    used = int(np.max(np.flatnonzero(std), initial=0)) + 1
    return std[:used]


def _shapes(count: int) -> tuple[Float, Float, Float]:
    """Return the relative sizes of all terms: k2 alone, k2 and k3, the remainder."""
    k2, both, rest = np.zeros(count), np.zeros(count), np.zeros(count)
    k2[0], both[:2] = 1.0, (1.0, 0.5)
    degree = 1
    while 2 + 2 * len(monomials(degree)) < count:
        degree += 1
    rest[2:] = np.repeat([1 / np.sqrt(factorial(i) * factorial(j)) for i, j in monomials(degree)], 2)
    return k2, both, rest


def _log_evidence(normal: Float, side: Float, std: Float) -> float:
    used = np.flatnonzero(std)
    if not len(used):
        return 0.0
    # Rounding may leave the matrix slightly indefinite, so negative values count as 0.
    sizes, directions = np.linalg.eigh(std[used, None] * normal[np.ix_(used, used)] * std[used])
    sizes = np.maximum(sizes, 0.0)
    explained = directions.T @ (std[used] * side[used])
    return float(0.5 * (explained**2 / (1 + sizes) - np.log1p(sizes)).sum())
