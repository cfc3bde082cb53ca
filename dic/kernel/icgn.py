"""The inverse compositional Gauss-Newton method (IC-GN) for one point, with affine shape functions.

It minimises the zero-mean normalised sum of squared differences (ZNSSD):
B. Pan, K. Li, W. Tong, "Fast, robust and accurate digital image correlation calculation without redundant
computations", Experimental Mechanics 53 (2013) 1277-1289.

A warp is the vector p = (u, u_x, u_y, v, v_x, v_y): the subset pixel at (x, y) from the point of the
reference is seen u + u_x x + u_y y further right and v + v_x x + v_y y further down in the deformed image.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dic.field import Status
from dic.kernel.jit import compiled
from dic.kernel.layout import Reference
from dic.kernel.moments import (
    FF,
    FG,
    FX,
    FX_F,
    FY,
    FY_F,
    GG,
    MOMENTS,
    REFERENCE_MOMENTS,
    F,
    Flat,
    G,
    Taps,
    moments_of_any_warp,
    moments_of_smooth_warp,
    reference_moments,
)  # fmt: skip

Float = NDArray[np.float64]

CONVERGED, NO_TEXTURE = int(Status.CONVERGED), int(Status.NO_TEXTURE)
OUT_OF_VIEW, NOT_CONVERGED = int(Status.OUT_OF_VIEW), int(Status.NOT_CONVERGED)
LOW_CORRELATION = int(Status.LOW_CORRELATION)

PARAMETERS = 6
EDGE_PX = 2
"""Pixels along the deformed image's edge that are not used: the spline guesses what follows there."""


class Limits(NamedTuple):
    """The settings of a correlation that the kernel needs; `radius` is half of the subset's width."""

    radius: int
    min_zncc: float
    tolerance_px: float
    max_iterations: int


class Workspace(NamedTuple):
    """Memory that all points of one thread use in turn."""

    H: Float
    s: Float
    t: Float
    d: Float
    b: Float
    q: Flat
    Q: Flat
    S: Flat
    shift: Flat
    place: NDArray[np.int64]


@compiled
def workspace(r: int) -> Workspace:
    """Return memory for subsets of radius `r`."""
    n = 2 * r + 1
    return Workspace(
        np.empty((PARAMETERS, PARAMETERS)),
        np.empty(PARAMETERS),
        np.empty(PARAMETERS),
        np.empty(PARAMETERS),
        np.empty(PARAMETERS),
        np.empty(PARAMETERS, np.float32),
        np.empty(REFERENCE_MOMENTS, np.float32),
        np.empty(MOMENTS, np.float32),
        np.empty((2, n), np.float32),
        np.empty((2, n), np.int64),
    )


@compiled
def _normal_matrix(Q: Flat, n: int, H: Float, s: Float, t: Float) -> tuple[float, float]:
    """Write the Gauss-Newton Hessian of the normalised criterion; return the mean and norm² of the subset.

    It is H - ss'/n - tt'/|f̃|²: s sums the steepest-descent vectors, t sums them times f̃, the two directions
    (offset and gain of the grey levels) to which the ZNSSD is blind. The right-hand side stays the classic
    one, so the result is the same and fewer iterations find it.
    """
    mean = Q[F] / n
    norm2 = Q[FF] - Q[F] * mean
    for i in range(3):
        for j in range(3):
            k = i + j if i * j == 0 else i + j + 1
            H[i, j], H[i, j + 3], H[i + 3, j + 3] = Q[k], Q[k + 6], Q[k + 12]
            H[i + 3, j] = Q[k + 6]
        s[i], s[i + 3] = Q[FX + i], Q[FY + i]
        t[i], t[i + 3] = Q[FX_F + i] - mean * s[i], Q[FY_F + i] - mean * s[i + 3]
    for i in range(PARAMETERS):
        for j in range(PARAMETERS):
            H[i, j] -= s[i] * s[j] / n + t[i] * t[j] / norm2
    return mean, norm2


@compiled
def _cholesky(A: Float) -> bool:
    """Replace the lower triangle of `A` by its Cholesky factor; False if `A` is not positive definite."""
    for i in range(PARAMETERS):
        limit = 1e-6 * A[i, i]
        for j in range(i + 1):
            s = A[i, j]
            for k in range(j):
                s -= A[i, k] * A[j, k]
            if i == j:
                if not s > limit:
                    return False
                A[i, i] = np.sqrt(s)
            else:
                A[i, j] = s / A[j, j]
    return True


@compiled
def _solve(L: Float, b: Float, x: Float) -> None:
    """Solve L L' x = b."""
    for i in range(PARAMETERS):
        s = b[i]
        for j in range(i):
            s -= L[i, j] * x[j]
        x[i] = s / L[i, i]
    for i in range(PARAMETERS - 1, -1, -1):
        s = x[i]
        for j in range(i + 1, PARAMETERS):
            s -= L[j, i] * x[j]
        x[i] = s / L[i, i]


@compiled
def _compose_inverse(p: Float, d: Float) -> None:
    """Replace the warp p by p ∘ d⁻¹."""
    a, b, c, e = 1.0 + d[1], d[2], d[4], 1.0 + d[5]
    det = a * e - b * c
    ia, ib, ic, ie = e / det, -b / det, -c / det, a / det
    ix, iy = -(ia * d[0] + ib * d[3]), -(ic * d[0] + ie * d[3])
    A, B, C, E = 1.0 + p[1], p[2], p[4], 1.0 + p[5]
    p[0] += A * ix + B * iy
    p[3] += C * ix + E * iy
    p[1], p[2] = A * ia + B * ic - 1.0, A * ib + B * ie
    p[4], p[5] = C * ia + E * ic, C * ib + E * ie - 1.0


@compiled
def _in_view(image: Reference, x: int, y: int, r: int, p: Float) -> bool:
    """Tell whether the warped subset, whose corners are its farthest points, stays in the image."""
    reach_x = r * (abs(1.0 + p[1]) + abs(p[2]))
    reach_y = r * (abs(p[4]) + abs(1.0 + p[5]))
    to_x, to_y = x + p[0], y + p[3]
    across = to_x - reach_x >= EDGE_PX and to_x + reach_x < image.width - EDGE_PX - 1
    down = to_y - reach_y >= EDGE_PX and to_y + reach_y < image.height - EDGE_PX - 1
    return bool(across and down)


@compiled
def correlate_point(
    image: Reference,
    c: Flat,
    taps: Taps,
    limits: Limits,
    x: int,
    y: int,
    pixels: int,
    p: Float,
    work: Workspace,
) -> tuple[int, float, int]:
    """Improve the warp `p` of one point in place; return its status, ZNCC and number of iterations."""
    r, H, s, t, d, b, q, S = limits.radius, work.H, work.s, work.t, work.d, work.b, work.q, work.S
    centre = image.origin + y * image.pitch + x
    reference_moments(image, centre, r, work.Q)
    mean, norm2 = _normal_matrix(work.Q, pixels, H, s, t)
    if not norm2 > 0.0 or not _cholesky(H):
        return NO_TEXTURE, np.nan, 0
    clipped = pixels < (2 * r + 1) ** 2
    zncc, last = np.nan, 0.0
    for iteration in range(1, limits.max_iterations + 1):
        if not _in_view(image, x, y, r, p):
            return OUT_OF_VIEW, np.nan, iteration
        for i in range(PARAMETERS):
            q[i] = p[i]
        # The offset within a strip is what the pixel grid moves along with; the rest is the warp's.
        if 15.0 * max(abs(p[1]), abs(p[4])) < 1.0:
            moments_of_smooth_warp(image, c, taps, centre, r, q, clipped, work.shift, work.place, S)
        else:
            moments_of_any_warp(image, c, taps, centre, r, q, S)
        g_mean = S[G] / pixels
        g_norm2 = S[GG] - S[G] * g_mean
        if not g_norm2 > 0.0:
            return LOW_CORRELATION, np.nan, iteration
        gain = np.sqrt(norm2 / g_norm2)
        zncc = (S[FG] - mean * S[G]) * gain / norm2
        for i in range(PARAMETERS):
            b[i] = gain * (S[i] - g_mean * s[i]) - t[i]
        _solve(H, b, d)
        length = np.sqrt(d[0] ** 2 + d[3] ** 2 + r * r * (d[1] ** 2 + d[2] ** 2 + d[4] ** 2 + d[5] ** 2))
        if not length < 2.0 * r:
            return NOT_CONVERGED, zncc, iteration
        _compose_inverse(p, d)
        rate = length / last
        last = length
        # Steps shrink by a nearly constant rate, which predicts what all later ones would add.
        if length < limits.tolerance_px or (
            rate < 0.5 and length * rate / (1.0 - rate) < limits.tolerance_px
        ):
            return (CONVERGED if zncc >= limits.min_zncc else LOW_CORRELATION), zncc, iteration
    return NOT_CONVERGED, zncc, limits.max_iterations
