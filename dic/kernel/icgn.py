"""The inverse compositional Gauss-Newton method (IC-GN) for one point.

It minimises the zero-mean normalised sum of squared differences (ZNSSD):
B. Pan, K. Li, W. Tong, "Fast, robust and accurate digital image correlation calculation without redundant
computations", Experimental Mechanics 53 (2013) 1277-1289; with quadratic shape functions: Y. Gao et al.,
"High-efficiency and high-accuracy digital image correlation for three-dimensional measurement",
Optics and Lasers in Engineering 65 (2015) 73-80.

A warp is the vector p = (u, u_x, u_y, v, v_x, v_y), which quadratic ones continue with (u_xx, u_xy, u_yy,
v_xx, v_xy, v_yy): the subset pixel at (x, y) from the point of the reference is seen
u + u_x x + u_y y + u_xx x²/2 + u_xy xy + u_yy y²/2 further right in the deformed image, and with v likewise
further down.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dic.field import Status
from dic.kernel import moments as m
from dic.kernel.jit import inner
from dic.kernel.layout import Deformed, Reference

Flat = NDArray[np.float32]
Float = NDArray[np.float64]

CONVERGED, NO_TEXTURE = int(Status.CONVERGED), int(Status.NO_TEXTURE)
OUT_OF_VIEW, NOT_CONVERGED = int(Status.OUT_OF_VIEW), int(Status.NOT_CONVERGED)
LOW_CORRELATION = int(Status.LOW_CORRELATION)

EDGE_PX = 2
"""Pixels along the deformed image's edge that are not used: the spline guesses what follows there."""

_FAR_PX = 0.5
"""A quadratic step longer than this is replaced by the affine one."""

_EPSILON = 2.0**-23
"""Relative distance of neighbouring float32, in which moments are summed."""

_WIDEST = 5.0
"""Deviations are never widened by more than this."""

# For each parameter: whether it moves along x (0) or y (1), and powers of x and y and factor of its monomial.
_SIDE = np.array([0, 0, 0, 1, 1, 1, 0, 0, 0, 1, 1, 1])
_POWER_X = np.array([0, 1, 0, 0, 1, 0, 2, 1, 0, 2, 1, 0])
_POWER_Y = np.array([0, 0, 1, 0, 0, 1, 0, 1, 2, 0, 1, 2])
_FACTOR = np.array([1, 1, 1, 1, 1, 1, 0.5, 1, 0.5, 0.5, 1, 0.5])


class Limits(NamedTuple):
    """The settings of a correlation that the kernel needs.

    `radius` is half of the subset's width; the gains are those of `dic.spline`, of white noise by
    interpolation half-way between pixels and by the derivative.
    """

    radius: int
    min_zncc: float
    tolerance_px: float
    max_iterations: int
    noise_gain: float
    slope_noise_gain: float


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
def _monomial(power_x: int, power_y: int) -> int:
    """Return the place of x^power_x y^power_y among the monomials."""
    degree = power_x + power_y
    return degree * (degree + 1) // 2 + power_y


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
        k = _monomial(_POWER_X[i], _POWER_Y[i]) + 6 * _SIDE[i]
        s[i] = _FACTOR[i] * Q[m.FX + k]
        t[i] = _FACTOR[i] * Q[m.FX_F + k] - mean * s[i]
    for i in range(len(s)):
        for j in range(i + 1):
            k = _monomial(_POWER_X[i] + _POWER_X[j], _POWER_Y[i] + _POWER_Y[j])
            product = Q[m.PRODUCTS + 15 * (_SIDE[i] + _SIDE[j]) + k]
            H[i, j] = _FACTOR[i] * _FACTOR[j] * product - s[i] * s[j] / n - t[i] * t[j] / norm2
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
def _compose_inverse(p: Float, d: Float) -> None:
    """Replace the affine warp p by p ∘ d⁻¹."""
    a, b, c, e = 1.0 + d[1], d[2], d[4], 1.0 + d[5]
    det = a * e - b * c
    ia, ib, ic, ie = e / det, -b / det, -c / det, a / det
    ix, iy = -(ia * d[0] + ib * d[3]), -(ic * d[0] + ie * d[3])
    A, B, C, E = 1.0 + p[1], p[2], p[4], 1.0 + p[5]
    p[0] += A * ix + B * iy
    p[3] += C * ix + E * iy
    p[1], p[2] = A * ia + B * ic - 1.0, A * ib + B * ie
    p[4], p[5] = C * ia + E * ic, C * ib + E * ie - 1.0


@inner
def _square_matrix(d: Float, D: Float) -> None:
    """Write the matrix by which a quadratic warp takes (x², xy, y², x, y, 1) to the same of the warped pixel.

    Gao et al. (2015), equation 12; terms above the second degree are dropped.
    """
    for side in range(2):
        row, at = 3 + side, 3 * side
        D[row, 0], D[row, 1], D[row, 2] = d[at + 6] / 2, d[at + 7], d[at + 8] / 2
        D[row, 3], D[row, 4], D[row, 5] = d[at + 1], d[at + 2], d[at]
        D[row, row] += 1.0
    for row in range(3):
        # x'x', x'y', y'y': products of the two polynomials above
        i, j = 3 + row // 2, 3 + (row + 1) // 2
        for k in range(5):
            D[row, k] = D[i, k] * D[j, 5] + D[i, 5] * D[j, k]
        D[row, 0] += D[i, 3] * D[j, 3]
        D[row, 1] += D[i, 3] * D[j, 4] + D[i, 4] * D[j, 3]
        D[row, 2] += D[i, 4] * D[j, 4]
        D[row, 5] = D[i, 5] * D[j, 5]
    for k in range(6):
        D[5, k] = 1.0 if k == 5 else 0.0


@inner
def _compose_inverse_quadratic(p: Float, d: Float, D: Float, rows: Float) -> None:
    """Replace the quadratic warp p by p ∘ d⁻¹, up to the third power of the small step d.

    (I + D)⁻¹ = I - D + D² - … ; what is left out vanishes with the last step, so the result is not changed.
    D and the rows, of the warp's matrix times 1, D and D², are memory to work in.
    """
    _square_matrix(d, D)
    for k in range(6):
        D[k, k] -= 1.0
    for side in range(2):
        at = 3 * side
        rows[0, 0], rows[0, 1], rows[0, 2] = p[at + 6] / 2, p[at + 7], p[at + 8] / 2
        rows[0, 3], rows[0, 4], rows[0, 5] = p[at + 1], p[at + 2], p[at]
        rows[0, 3 + side] += 1.0
        for power in range(1, 3):
            for j in range(6):
                rows[power, j] = 0.0
                for k in range(6):
                    rows[power, j] += rows[power - 1, k] * D[k, j]
        for k in range(6):
            rows[0, k] += rows[2, k] - rows[1, k]
        rows[0, 3 + side] -= 1.0
        p[at + 6], p[at + 7], p[at + 8] = 2.0 * rows[0, 0], rows[0, 1], 2.0 * rows[0, 2]
        p[at + 1], p[at + 2], p[at] = rows[0, 3], rows[0, 4], rows[0, 5]


@inner
def extrapolate(p: Float, dx: float, dy: float, q: Float) -> None:
    """Write into q the warp that p predicts for the point (dx, dy) further on."""
    for k in range(len(p)):
        q[k] = p[k]
    for at in (0, 3):
        q[at] += p[at + 1] * dx + p[at + 2] * dy
        if len(p) > 6:
            xx, xy, yy = p[at + 6], p[at + 7], p[at + 8]
            q[at] += xx * dx * dx / 2 + xy * dx * dy + yy * dy * dy / 2
            q[at + 1] += xx * dx + xy * dy
            q[at + 2] += xy * dx + yy * dy


@inner
def _step_length_px(d: Float, r: int) -> float:
    """Return how far a step moves the edge of the subset, at most about."""
    square = 0.0
    for i in range(len(d)):
        move = _FACTOR[i] * d[i]
        for _ in range(_POWER_X[i] + _POWER_Y[i]):
            move *= r
        square += move * move
    return math.sqrt(square)


@inner
def _in_view(image: Deformed, x: int, y: int, r: int, p: Float) -> bool:
    """Tell whether the warped subset stays in the image, by its corners and what curvature may add."""
    reach_x = r * (abs(1.0 + p[1]) + abs(p[2]))
    reach_y = r * (abs(p[4]) + abs(1.0 + p[5]))
    for i in range(6, len(p)):
        bulge = _FACTOR[i] * r * r * abs(p[i])
        if _SIDE[i] == 0:
            reach_x += bulge
        else:
            reach_y += bulge
    to_x, to_y = x + p[0], y + p[3]
    across = to_x - reach_x >= EDGE_PX and to_x + reach_x < image.width - EDGE_PX - 1
    down = to_y - reach_y >= EDGE_PX and to_y + reach_y < image.height - EDGE_PX - 1
    return bool(across and down)


@inner
def _is_smooth(p: Float, r: int) -> bool:
    """Tell whether 16 pixels of any row of the subset move alike to within a pixel."""
    steepest_x, steepest_y = abs(p[1]), abs(p[4])
    if len(p) > 6:
        steepest_x += r * (abs(p[6]) + abs(p[7]))
        steepest_y += r * (abs(p[9]) + abs(p[10]))
    return bool(16.0 * max(steepest_x, steepest_y) < 1.0)


@inner
def _deviations(L: Float, variance: float, y: Float, deviations: Float) -> None:
    """Write the standard deviations of the first six parameters: of variance × (L L')⁻¹, the diagonal."""
    for k in range(6):
        square = 0.0
        for i in range(k, len(y)):
            s = 1.0 if i == k else 0.0
            for j in range(k, i):
                s -= L[i, j] * y[j]
            y[i] = s / L[i, i]
            square += y[i] * y[i]
        deviations[k] = math.sqrt(variance * square)


@inner
def _widen(Q: Flat, n: int, slope_noise: float, deviations: Float) -> None:
    """Take the noise out of the slopes' sums of squares, which it makes look like texture.

    What is left tells by how much the deviations along each axis are too small, at most `_WIDEST` times: a
    larger residual is not noise but light or paint that changed. `slope_noise` is the noise's variance in a
    slope.
    """
    for side in range(2):
        apparent = Q[m.PRODUCTS + 30 * side]
        texture = max(apparent - n * slope_noise, apparent / _WIDEST)
        factor = apparent / texture
        for k in range(3 * side, 3 * side + 3):
            deviations[k] *= factor


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
    deviations: Float,
    work: Workspace,
) -> tuple[int, float, int]:
    """Improve the warp `p` of one point in place; return its status, ZNCC and number of iterations.

    `deviations` takes the standard deviations of the first six parameters.
    """
    r, H, s, t, d, b, q, S = limits.radius, work.H, work.s, work.t, work.d, work.b, work.q, work.S
    centre = image.origin + y * image.pitch + x
    target = deformed.origin + y * deformed.pitch + x
    m.reference_moments(image, shape, centre, r, work.Q)
    mean, norm2 = _normal_matrix(work.Q, pixels, H, s, t)
    # Each of the rows' sums may lose a last digit: less than all of these is nothing.
    lost = (2 * r + 1) * _EPSILON
    flat = max(image.flat_variance * pixels, lost * work.Q[m.FF])
    if not norm2 > flat or not _cholesky(H):
        return NO_TEXTURE, np.nan, 0
    clipped = pixels < (2 * r + 1) * (2 * r + 1)
    zncc, last = np.nan, 0.0
    for iteration in range(1, limits.max_iterations + 1):
        if not _in_view(deformed, x, y, r, p):
            return OUT_OF_VIEW, np.nan, iteration
        for i in range(len(p)):
            q[i] = p[i]
        m.moments_with_image(
            image, deformed, taps, shape, centre, target, r, q, _is_smooth(p, r), clipped,
            work.shift, work.place, S,
        )  # fmt: skip
        g_mean = S[m.G] / pixels
        g_norm2 = S[m.GG] - S[m.G] * g_mean
        if not g_norm2 > lost * S[m.GG]:
            return LOW_CORRELATION, np.nan, iteration
        gain = math.sqrt(norm2 / g_norm2)
        zncc = (S[m.FG] - mean * S[m.G]) * gain / norm2
        for i in range(len(p)):
            k = _monomial(_POWER_X[i], _POWER_Y[i]) + 6 * _SIDE[i]
            b[i] = gain * (_FACTOR[i] * S[m.FX_G + k] - g_mean * s[i]) - t[i]
        _solve(H, b, len(b), d)
        length = _step_length_px(d, r)
        if len(shape) == 12 and length > _FAR_PX:
            # Far from the goal curvature misleads: the affine part alone, whose factor leads the whole one's.
            # (Its six parameters are those that have deviations.)
            _solve(H, b, len(deviations), d)
        if not length < 2.0 * r:
            return NOT_CONVERGED, zncc, iteration
        if len(shape) == 12:
            _compose_inverse_quadratic(p, d, work.D, work.rows)
        else:
            _compose_inverse(p, d)
        rate = length / last
        last = length
        # Steps shrink by a nearly constant rate, which predicts what all later ones would add.
        if length < limits.tolerance_px or (
            rate < 0.5 and length * rate / (1.0 - rate) < limits.tolerance_px
        ):
            residual2 = 2.0 * norm2 * max(0.0, 1.0 - zncc)
            variance = _noise_variance(residual2, pixels, p, r, limits.noise_gain)
            _deviations(H, variance, d, deviations)
            _widen(work.Q, pixels, variance / 2.0 * limits.slope_noise_gain, deviations)
            return (CONVERGED if zncc >= limits.min_zncc else LOW_CORRELATION), zncc, iteration
    return NOT_CONVERGED, zncc, limits.max_iterations
