"""The inverse compositional Gauss-Newton method (IC-GN) for one point.

It minimises the zero-mean normalised sum of squared differences (ZNSSD):
B. Pan, K. Li, W. Tong, "Fast, robust and accurate digital image correlation calculation without redundant
computations", Experimental Mechanics 53 (2013) 1277-1289; with quadratic shape functions: Y. Gao et al.,
"High-efficiency and high-accuracy digital image correlation for three-dimensional measurement",
Optics and Lasers in Engineering 65 (2015) 73-80.

Warps are those of `dic.correlation.kernel.warps`.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dic.correlation.kernel import moments as m
from dic.correlation.kernel.jit import inner
from dic.correlation.kernel.layout import Deformed, Reference
from dic.correlation.kernel.warps import (
    FACTOR,
    POWER_X,
    POWER_Y,
    SIDE,
    compose_inverse,
    compose_inverse_quadratic,
    in_view,
    is_smooth,
    monomial,
    step_length_px,
)
from dic.correlation.status import Status

Flat = NDArray[np.float32]
Float = NDArray[np.float64]

CONVERGED, NO_TEXTURE = int(Status.CONVERGED), int(Status.NO_TEXTURE)
OUT_OF_VIEW, NOT_CONVERGED = int(Status.OUT_OF_VIEW), int(Status.NOT_CONVERGED)
LOW_CORRELATION = int(Status.LOW_CORRELATION)

_FAR_PX = 0.5
"""A quadratic step longer than this is replaced by the affine one."""

_EPSILON = 2.0**-23
"""Relative distance of neighbouring float32, in which moments are summed."""

# Places in the record of a point.
_MEAN, _NORM2, _FX_FX, _FY_FY, _S = 0, 1, 2, 3, 4

_WIDEST = 5.0
"""Deviations are never widened by more than this."""


class Limits(NamedTuple):
    """The settings of a correlation that the kernel needs.

    `radius` is half of the subset's width; the gains are those of `dic.image.spline`, of white noise by
    interpolation half-way between pixels and by the derivative.
    """

    radius: int
    min_zncc: float
    tolerance_px: float
    max_iterations: int
    noise_gain: float
    slope_noise_gain: float


class Prepared(NamedTuple):
    """What IC-GN needs of the subsets of a reference, for those points of a grid where it is known already.

    Attributes
    ----------
    known : ndarray of bool, shape (rows, columns)
    records : ndarray of float32, shape (rows, columns, n)
        Mean, norm² (NaN without texture), ∑fx² and ∑fy², then s, t and the Cholesky factor of H.
    """

    known: NDArray[np.bool_]
    records: NDArray[np.float32]

    @classmethod
    def empty(cls, shape: tuple[int, int], parameters: int) -> "Prepared":
        """Return room for the points of a grid, which takes memory only as it is filled."""
        return cls(np.zeros(shape, np.bool_), np.empty((*shape, record_length(parameters)), np.float32))


def record_length(parameters: int) -> int:
    """Return how many numbers are kept of a point."""
    return _S + 2 * parameters + parameters * (parameters + 1) // 2


class Workspace(NamedTuple):
    """Memory that all points of one thread use in turn."""

    H: Float
    s: Float
    t: Float
    d: Float
    b: Float
    D: Float
    rows: Float
    p: Float
    q: Flat
    Q: Flat
    S: Flat
    shift: Flat
    place: NDArray[np.int64]


def workspace(radius: int, parameters: int) -> Workspace:
    """Return memory for subsets of a radius and warps of so many parameters."""
    H, D, rows = np.empty((parameters, parameters)), np.empty((6, 6)), np.empty((3, 6))
    s, t, d, b, p = np.empty((5, parameters))
    q, Q = np.empty(parameters, np.float32), np.empty(m.REFERENCE_MOMENTS, np.float32)
    S, width = np.empty(m.MOMENTS, np.float32), 2 * radius + 1
    shift, place = np.empty((2, width), np.float32), np.empty((2, width), np.int64)
    return Workspace(H, s, t, d, b, D, rows, p, q, Q, S, shift, place)


@inner
def _normal_matrix(Q: Flat, n: int, H: Float, s: Float, t: Float) -> tuple[float, float]:
    """Write the Gauss-Newton Hessian of the normalised criterion; return the mean and norm² of the subset.

    It is H - ss'/n - tt'/|f̃|²: s sums the steepest-descent vectors, t sums them times f̃, the two directions
    (offset and gain of the grey levels) to which the ZNSSD is blind. The right-hand side stays the classic
    one, so the result is the same and fewer iterations find it.
    """
    mean = Q[m.F] / n
    norm2 = Q[m.FF] - Q[m.F] * mean
    for i in range(len(s)):
        k = monomial(POWER_X[i], POWER_Y[i]) + 6 * SIDE[i]
        s[i] = FACTOR[i] * Q[m.FX + k]
        t[i] = FACTOR[i] * Q[m.FX_F + k] - mean * s[i]
    for i in range(len(s)):
        for j in range(i + 1):
            k = monomial(POWER_X[i] + POWER_X[j], POWER_Y[i] + POWER_Y[j])
            product = Q[m.PRODUCTS + 15 * (SIDE[i] + SIDE[j]) + k]
            H[i, j] = FACTOR[i] * FACTOR[j] * product - s[i] * s[j] / n - t[i] * t[j] / norm2
    return mean, norm2


@inner
def _cholesky(A: Float) -> bool:
    """Replace the lower triangle of `A` by its Cholesky factor; False if `A` is not positive definite."""
    for i in range(len(A)):
        limit = 1e-6 * A[i, i]
        for j in range(i + 1):
            s = A[i, j]
            for k in range(j):
                s -= A[i, k] * A[j, k]
            if i == j:
                if not s > limit:
                    return False
                A[i, i] = math.sqrt(s)
            else:
                A[i, j] = s / A[j, j]
    return True


@inner
def _prepare(
    image: Reference, shape: m.Shape, centre: int, r: int, pixels: int, work: Workspace, record: Flat
) -> None:
    """Write what iterations need of the subset around the element `centre` of the reference."""
    Q, H, s, t = work.Q, work.H, work.s, work.t
    m.reference_moments(image, shape, centre, r, Q)
    mean, norm2 = _normal_matrix(Q, pixels, H, s, t)
    flat = max(image.flat_variance * pixels, _lost(r) * Q[m.FF])
    has_texture = norm2 > flat and _cholesky(H)
    record[_MEAN], record[_NORM2] = mean, norm2 if has_texture else np.nan
    record[_FX_FX], record[_FY_FY] = Q[m.PRODUCTS], Q[m.PRODUCTS + 30]
    k = _S
    for i in range(len(s)):
        record[k], record[k + 1] = s[i], t[i]
        k += 2
        for j in range(i + 1):
            record[k] = H[i, j]
            k += 1


@inner
def _recall(record: Flat, work: Workspace) -> None:
    """Unfold s, t and the Cholesky factor of a record.

    Rounded to float32 they are the same whether they have been kept or were prepared just now.
    """
    H, s, t = work.H, work.s, work.t
    k = _S
    for i in range(len(s)):
        s[i], t[i] = record[k], record[k + 1]
        k += 2
        for j in range(i + 1):
            H[i, j] = record[k]
            k += 1


@inner
def _lost(r: int) -> float:
    """Return what share of a sum over the subset may be rounding: each of its rows may lose a last digit."""
    return (2 * r + 1) * _EPSILON


@inner
def _solve(L: Float, b: Float, n: int, x: Float) -> None:
    """Solve the leading n equations of L L' x = b for the leading n unknowns; the others become 0."""
    for i in range(n):
        s = b[i]
        for j in range(i):
            s -= L[i, j] * x[j]
        x[i] = s / L[i, i]
    for i in range(n - 1, -1, -1):
        s = x[i]
        for j in range(i + 1, n):
            s -= L[j, i] * x[j]
        x[i] = s / L[i, i]
    for i in range(n, len(b)):
        x[i] = 0.0


@inner
def _write_std(L: Float, variance: float, y: Float, std: Float) -> None:
    """Write the standard deviations of the first six parameters: of variance × (L L')⁻¹, the diagonal."""
    for k in range(6):
        square = 0.0
        for i in range(k, len(y)):
            s = 1.0 if i == k else 0.0
            for j in range(k, i):
                s -= L[i, j] * y[j]
            y[i] = s / L[i, i]
            square += y[i] * y[i]
        std[k] = math.sqrt(variance * square)


@inner
def _widen(record: Flat, n: int, slope_noise: float, std: Float) -> None:
    """Take the noise out of the slopes' sums of squares, which it makes look like texture.

    What is left tells by how much the deviations along each axis are too small, at most `_WIDEST` times: a
    larger residual is not noise but light or paint that changed. `slope_noise` is the noise's variance in a
    slope.
    """
    for side in range(2):
        apparent = record[_FX_FX + side]
        texture = max(apparent - n * slope_noise, apparent / _WIDEST)
        factor = apparent / texture
        for k in range(3 * side, 3 * side + 3):
            std[k] *= factor


@inner
def _sinc(x: float) -> float:
    """Return sin(πx) / (πx)."""
    return math.sin(np.pi * x) / (np.pi * x) if x != 0.0 else 1.0


@inner
def _noise_variance(residual2: float, n: int, p: Float, r: int, noise_gain: float) -> float:
    """Return twice the variance of the images' noise, as the residuals of n pixels of a subset tell.

    Both images have it. Interpolation between pixels damps that of the deformed one, to `noise_gain` half-way
    and by the cosine in between, though not that which a displacement feels: it is put back.
    """
    damping = 1.0
    for at in (0, 3):
        # A gradient passes several sub-pixel positions within the subset, which averages the cosine.
        swing = math.cos(2.0 * np.pi * p[at]) * _sinc(2.0 * r * p[at + 1]) * _sinc(2.0 * r * p[at + 2])
        damping *= (1.0 + noise_gain + (1.0 - noise_gain) * swing) / 2.0
    return 2.0 * residual2 / (n - len(p) - 2) / (1.0 + damping)


@inner
def correlate_point(
    image: Reference,
    deformed: Deformed,
    taps: m.Taps,
    shape: m.Shape,
    limits: Limits,
    x: int,
    y: int,
    pixels: int,
    p: Float,
    std: Float,
    record: Flat,
    known: bool,
    work: Workspace,
) -> tuple[int, float, int]:
    """Improve the warp `p` of one point in place; return its status, ZNCC and number of iterations.

    `std` takes the standard deviations of the first six parameters, `record` what is needed of the
    reference's subset, unless that is known from another image.
    """
    r, H, s, t, d, b, q, S = limits.radius, work.H, work.s, work.t, work.d, work.b, work.q, work.S
    centre = image.origin + y * image.pitch + x
    target = deformed.origin + y * deformed.pitch + x
    if not known:
        _prepare(image, shape, centre, r, pixels, work, record)
    _recall(record, work)
    mean, norm2 = record[_MEAN], record[_NORM2]
    if not norm2 > 0.0:
        return NO_TEXTURE, np.nan, 0
    clipped = pixels < (2 * r + 1) * (2 * r + 1)
    zncc, last = np.nan, 0.0
    for iteration in range(1, limits.max_iterations + 1):
        if not in_view(deformed, x, y, r, p):
            return OUT_OF_VIEW, np.nan, iteration
        for i in range(len(p)):
            q[i] = p[i]
        m.moments_with_image(
            image, deformed, taps, shape, centre, target, r, q, is_smooth(p, r), clipped,
            work.shift, work.place, S,
        )  # fmt: skip
        g_mean = S[m.G] / pixels
        g_norm2 = S[m.GG] - S[m.G] * g_mean
        if not g_norm2 > _lost(r) * S[m.GG]:
            return LOW_CORRELATION, np.nan, iteration
        gain = math.sqrt(norm2 / g_norm2)
        zncc = (S[m.FG] - mean * S[m.G]) * gain / norm2
        for i in range(len(p)):
            k = monomial(POWER_X[i], POWER_Y[i]) + 6 * SIDE[i]
            b[i] = gain * (FACTOR[i] * S[m.FX_G + k] - g_mean * s[i]) - t[i]
        _solve(H, b, len(b), d)
        length = step_length_px(d, r)
        if len(shape) == 12 and length > _FAR_PX:
            # Far from the goal curvature misleads: the affine part alone, whose factor leads the whole one's.
            # (Its six parameters are those that have deviations.)
            _solve(H, b, len(std), d)
        if not length < 2.0 * r:
            return NOT_CONVERGED, zncc, iteration
        if len(shape) == 12:
            compose_inverse_quadratic(p, d, work.D, work.rows)
        else:
            compose_inverse(p, d)
        rate = length / last
        last = length
        # Steps shrink by a nearly constant rate, which predicts what all later ones would add.
        if length < limits.tolerance_px or (
            rate < 0.5 and length * rate / (1.0 - rate) < limits.tolerance_px
        ):
            residual2 = 2.0 * norm2 * max(0.0, 1.0 - zncc)
            variance = _noise_variance(residual2, pixels, p, r, limits.noise_gain)
            _write_std(H, variance, d, std)
            _widen(record, pixels, variance / 2.0 * limits.slope_noise_gain, std)
            return (CONVERGED if zncc >= limits.min_zncc else LOW_CORRELATION), zncc, iteration
    return NOT_CONVERGED, zncc, limits.max_iterations
