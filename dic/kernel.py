"""Subset correlation of one point and its reliability-guided propagation, compiled.

The criterion is the zero-mean normalised sum of squared differences (ZNSSD), minimised by the inverse
compositional Gauss-Newton method (IC-GN) with affine shape functions:
B. Pan, K. Li, W. Tong, "Fast, robust and accurate digital image correlation calculation without redundant
computations", Experimental Mechanics 53 (2013) 1277-1289. Points are visited from the best outwards:
B. Pan, "Reliability-guided digital image correlation for image deformation measurement",
Applied Optics 48 (2009) 1535-1542.

A warp is the vector p = (u, u_x, u_y, v, v_x, v_y): the subset pixel at (dx, dy) from the point (x, y) of the
reference is seen at (x + dx + u + u_x dx + u_y dy, y + dy + v + v_x dx + v_y dy) of the deformed image.
Everything that numba compiles for correlation is in this one file, because its cache is valid per file.
"""

import heapq

import numpy as np
from numpy.typing import NDArray

from dic.field import Status
from dic.jit import compiled
from dic.spline import MARGIN

Grey = NDArray[np.float32]
Float = NDArray[np.float64]

CONVERGED, NO_TEXTURE = int(Status.CONVERGED), int(Status.NO_TEXTURE)
OUT_OF_VIEW, NOT_CONVERGED = int(Status.OUT_OF_VIEW), int(Status.NOT_CONVERGED)
LOW_CORRELATION = int(Status.LOW_CORRELATION)

PARAMETERS = 6
EDGE_PX = 2
"""Pixels along the deformed image's edge that are not used: the spline guesses what follows there."""


@compiled
def _cubic_weights(t: float) -> tuple[float, float, float, float]:
    """Return the weights of the four taps around a position whose fractional part is `t`."""
    s = 1.0 - t
    t2, s2 = t * t, s * s
    return (
        s2 * s / 6.0,
        (4.0 + t2 * (3.0 * t - 6.0)) / 6.0,
        (4.0 + s2 * (3.0 * s - 6.0)) / 6.0,
        t2 * t / 6.0,
    )


@compiled
def _quintic_weights(t: float) -> tuple[float, float, float, float, float, float]:
    """Return the weights of the six taps around a position whose fractional part is `t`."""
    s = 1.0 - t
    t2, s2 = t * t, s * s
    return (
        s2 * s2 * s / 120.0,
        (26.0 + t * (-50.0 + t * (20.0 + t * (20.0 + t * (-20.0 + 5.0 * t))))) / 120.0,
        (66.0 + t2 * (-60.0 + t2 * (30.0 - 10.0 * t))) / 120.0,
        (66.0 + s2 * (-60.0 + s2 * (30.0 - 10.0 * s))) / 120.0,
        (26.0 + s * (-50.0 + s * (20.0 + s * (20.0 + s * (-20.0 + 5.0 * s))))) / 120.0,
        t2 * t2 * t / 120.0,
    )


@compiled
def _interpolate(c: Grey, order: int, x: float, y: float) -> float:
    """Return the spline's grey level at (x, y), which the caller knows to be in view.

    The taps are written out, not looped over: unrolled they run several times faster.
    """
    column, row = int(x), int(y)
    tx, ty = x - column, y - row
    grey = 0.0
    if order == 3:
        a0, a1, a2, a3 = _cubic_weights(tx)
        i, j = column + MARGIN - 1, row + MARGIN - 1
        for b in _cubic_weights(ty):
            grey += b * (a0 * c[j, i] + a1 * c[j, i + 1] + a2 * c[j, i + 2] + a3 * c[j, i + 3])
            j += 1
    else:
        a0, a1, a2, a3, a4, a5 = _quintic_weights(tx)
        i, j = column + MARGIN - 2, row + MARGIN - 2
        for b in _quintic_weights(ty):
            near = a0 * c[j, i] + a1 * c[j, i + 1] + a2 * c[j, i + 2]
            grey += b * (near + a3 * c[j, i + 3] + a4 * c[j, i + 4] + a5 * c[j, i + 5])
            j += 1
    return grey


@compiled
def _gather(
    f: Grey,
    fx: Grey,
    fy: Grey,
    region: NDArray[np.bool_],
    x: int,
    y: int,
    r: int,
    offsets: Float,
    subset: Grey,
) -> int:
    """Collect the subset's pixels inside the region; return their number n.

    `offsets` (n, 2) takes their places (dx, dy), `subset` (n, 3) their grey level and its derivatives.
    """
    n = 0
    for dy in range(-r, r + 1):
        for dx in range(-r, r + 1):
            if region[y + dy, x + dx]:
                offsets[n, 0], offsets[n, 1] = dx, dy
                subset[n, 0] = f[y + dy, x + dx]
                subset[n, 1] = fx[y + dy, x + dx]
                subset[n, 2] = fy[y + dy, x + dx]
                n += 1
    return n


@compiled
def _steepest_descent(offset: Float, pixel: Grey, sd: Float) -> None:
    """Write the change of a pixel's grey level with each of the six parameters."""
    sd[0] = pixel[1]
    sd[1] = pixel[1] * offset[0]
    sd[2] = pixel[1] * offset[1]
    sd[3] = pixel[2]
    sd[4] = pixel[2] * offset[0]
    sd[5] = pixel[2] * offset[1]


@compiled
def _hessian(offsets: Float, subset: Grey, n: int, mean: float, norm: float, H: Float, sums: Float) -> None:
    """Write the Gauss-Newton Hessian of the normalised criterion, H - ss'/n - tt'/|f̃|².

    s sums the steepest-descent vectors, t sums them times f̃: the two directions (offset and gain of the grey
    levels) to which the ZNSSD is blind. `sums` keeps s for the right-hand side.
    """
    sd = np.empty(PARAMETERS)
    t = np.zeros(PARAMETERS)
    H[:] = 0.0
    sums[:] = 0.0
    for k in range(n):
        _steepest_descent(offsets[k], subset[k], sd)
        for i in range(PARAMETERS):
            sums[i] += sd[i]
            t[i] += sd[i] * (subset[k, 0] - mean)
            for j in range(i + 1):
                H[i, j] += sd[i] * sd[j]
    for i in range(PARAMETERS):
        for j in range(i + 1):
            H[i, j] -= sums[i] * sums[j] / n + t[i] * t[j] / (norm * norm)
            H[j, i] = H[i, j]


@compiled
def _cholesky(A: Float) -> bool:
    """Replace the lower triangle of `A` by its Cholesky factor; False if `A` is not positive definite."""
    for i in range(PARAMETERS):
        limit = 1e-10 * A[i, i]
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
def _correlate_point(
    f: Grey,
    fx: Grey,
    fy: Grey,
    region: NDArray[np.bool_],
    c: Grey,
    order: int,
    x: int,
    y: int,
    r: int,
    p: Float,
    min_zncc: float,
    tolerance_px: float,
    max_iterations: int,
) -> tuple[int, float, int]:
    """Improve the warp `p` of one point in place; return its status, ZNCC and number of iterations."""
    capacity = (2 * r + 1) ** 2
    offsets, subset = np.empty((capacity, 2)), np.empty((capacity, 3), np.float32)
    n = _gather(f, fx, fy, region, x, y, r, offsets, subset)
    if n <= PARAMETERS:
        return NO_TEXTURE, np.nan, 0
    mean = 0.0
    for k in range(n):
        mean += subset[k, 0]
    mean /= n
    norm2 = 0.0
    for k in range(n):
        norm2 += (subset[k, 0] - mean) ** 2
    norm = np.sqrt(norm2)
    H, sums = np.empty((PARAMETERS, PARAMETERS)), np.empty(PARAMETERS)
    if not norm2 > 0.0:
        return NO_TEXTURE, np.nan, 0
    _hessian(offsets, subset, n, mean, norm, H, sums)
    if not _cholesky(H):
        return NO_TEXTURE, np.nan, 0

    height, width = f.shape
    g, rhs = np.empty(n), np.empty(PARAMETERS)
    sd, d = np.empty(PARAMETERS), np.empty(PARAMETERS)
    zncc, last = np.nan, 0.0
    for iteration in range(1, max_iterations + 1):
        g_mean = 0.0
        for k in range(n):
            dx, dy = offsets[k, 0], offsets[k, 1]
            gx = x + dx + p[0] + p[1] * dx + p[2] * dy
            gy = y + dy + p[3] + p[4] * dx + p[5] * dy
            if not (EDGE_PX <= gx < width - EDGE_PX - 1 and EDGE_PX <= gy < height - EDGE_PX - 1):
                return OUT_OF_VIEW, np.nan, iteration
            g[k] = _interpolate(c, order, gx, gy)
            g_mean += g[k]
        g_mean /= n
        g_norm2, product = 0.0, 0.0
        for k in range(n):
            g_norm2 += (g[k] - g_mean) ** 2
            product += (g[k] - g_mean) * (subset[k, 0] - mean)
        if not g_norm2 > 0.0:
            return LOW_CORRELATION, np.nan, iteration
        gain = norm / np.sqrt(g_norm2)
        zncc = product * gain / norm2
        rhs[:] = 0.0
        for k in range(n):
            _steepest_descent(offsets[k], subset[k], sd)
            residual = gain * (g[k] - g_mean) - (subset[k, 0] - mean)
            for i in range(PARAMETERS):
                rhs[i] += sd[i] * residual
        _solve(H, rhs, d)
        length = np.sqrt(d[0] ** 2 + d[3] ** 2 + r * r * (d[1] ** 2 + d[2] ** 2 + d[4] ** 2 + d[5] ** 2))
        if not length < 2.0 * r:
            return NOT_CONVERGED, zncc, iteration
        _compose_inverse(p, d)
        rate = length / last
        last = length
        if length < tolerance_px or (rate < 0.5 and length * rate / (1.0 - rate) < tolerance_px):
            return (CONVERGED if zncc >= min_zncc else LOW_CORRELATION), zncc, iteration
    return NOT_CONVERGED, zncc, max_iterations


@compiled
def correlate_points(
    f: Grey,
    fx: Grey,
    fy: Grey,
    region: NDArray[np.bool_],
    c: Grey,
    order: int,
    points: NDArray[np.int64],
    r: int,
    warps: Float,
    min_zncc: float,
    tolerance_px: float,
    max_iterations: int,
    status: NDArray[np.int8],
    zncc: Float,
    iterations: NDArray[np.int16],
) -> None:
    """Correlate `points` (n, 2), each from its own warp in `warps` (n, 6); results are written in place."""
    for k in range(len(points)):
        status[k], zncc[k], iterations[k] = _correlate_point(
            f, fx, fy, region, c, order, points[k, 0], points[k, 1], r, warps[k],
            min_zncc, tolerance_px, max_iterations,
        )  # fmt: skip


@compiled
def propagate(
    f: Grey,
    fx: Grey,
    fy: Grey,
    region: NDArray[np.bool_],
    c: Grey,
    order: int,
    xs: NDArray[np.int64],
    ys: NDArray[np.int64],
    r: int,
    warps: Float,
    min_zncc: float,
    tolerance_px: float,
    max_iterations: int,
    status: NDArray[np.int8],
    zncc: Float,
    iterations: NDArray[np.int16],
    pending: NDArray[np.bool_],
) -> None:
    """Spread over the grid of points from those already converged, always continuing at the highest ZNCC.

    `xs` (columns), `ys` (rows) are the grid's coordinates; `warps` (rows, columns, 6), `status`, `zncc`,
    `iterations` and `pending` (rows, columns) are updated in place. A neighbour starts from the warp of the
    point that reached it, extrapolated by its gradients; one that fails may be tried again from another side.
    """
    rows, columns = status.shape
    heap = [(0.0, 0, 0)][:0]
    for row in range(rows):
        for column in range(columns):
            if status[row, column] == CONVERGED:
                heapq.heappush(heap, (-zncc[row, column], row, column))
    start = np.empty(PARAMETERS)
    while len(heap) > 0:
        _, row, column = heapq.heappop(heap)
        for side in range(4):
            i = row + (side == 0) - (side == 1)
            j = column + (side == 2) - (side == 3)
            if i < 0 or j < 0 or i >= rows or j >= columns or not pending[i, j]:
                continue
            dx, dy = xs[j] - xs[column], ys[i] - ys[row]
            start[:] = warps[row, column]
            start[0] += start[1] * dx + start[2] * dy
            start[3] += start[4] * dx + start[5] * dy
            outcome, quality, count = _correlate_point(
                f, fx, fy, region, c, order, xs[j], ys[i], r, start,
                min_zncc, tolerance_px, max_iterations,
            )  # fmt: skip
            status[i, j], zncc[i, j], iterations[i, j] = outcome, quality, count
            if outcome == CONVERGED:
                warps[i, j] = start
                pending[i, j] = False
                heapq.heappush(heap, (-quality, i, j))
