"""Fit surfaces to windows of points, compiled: the slopes of each window, and their covariances.

`dic.strain.fit` describes the method. Each window has its own points, so nothing is shared between windows.
"""

from typing import NamedTuple

import numpy as np

from dic.correlation.kernel.jit import compiled, inlined, inner
from dic.typing import Float, Indices, Mask


class SurfacePoints(NamedTuple):
    """The points of a grid, and which of them belong to the same piece of the surface."""

    position: Float
    vector: Float
    """Shape (rows, columns, 2). Position and displacement of each point. Values are needed only where `valid`
    is True.
    """
    valid: Mask
    """Shape (rows, columns). True for the points to which surfaces are fitted."""
    number: Indices
    """Shape (rows, columns) or (0, 0). Index of each point in `seen`, and -1 for a point that sees its whole
    window. The array has no elements if all points see each other.
    """
    seen: Mask
    """Shape (n, window, window). True for the points of a window that the point in the middle sees; see
    `dic.strain.sight`.
    """


class Errors(NamedTuple):
    """The errors of the displacements; see `dic.strain.displacement.Noise`."""

    factors: Float
    """Shape (rows, columns, 2, 2) or (0, 0, 2, 2). `Noise.factors`. The array has no elements if the errors
    are not known.
    """
    overlap: Float
    """Shape (m, n). `Noise.overlap`."""
    bias: Float
    """Shape (rows, columns, 2, 2) or (0, 0, 2, 2). `Noise.bias`. The array has no elements if there is no
    bias.
    """
    number: Indices
    """Shape (rows, columns) or (0, 0). Number of each point with a clipped subset, and -1 for all other
    points. The array has no elements if no subset is clipped.
    """
    clipped: Float
    """Shape (clipped points, 2 reach + 1, 2 reach + 1). `ClippedSubsets.correlations`, for at least the
    points of a window whose subsets overlap.
    """


class Work(NamedTuple):
    """Work arrays, which each window overwrites."""

    use: Mask
    used: Mask
    """Shape (window, window). True for the points to which the surface of this window, and of the window
    before, is fitted.
    """
    places: Float
    """Shape (window, window, 2). Positions of these points relative to the point in the middle, in the window
    before.
    """
    design: Float
    """Shape (terms, window, window). The terms of the fitted polynomial at the points. 3 terms (x, y, 1) give
    a plane; 6 terms (also x², xy, y²) give a quadratic surface.
    """
    normal: Float
    """Shape (terms, terms + 2). The normal equations."""
    weights: Float
    """Shape (window, window, 2). Weight of each point's displacement in the two slopes at the middle; 0 where
    `use` is False.
    """
    parts: Float
    """Shape (window², 8). The weighted factors of each point."""
    number: Indices
    """Shape (window, window). Number of each point with a clipped subset, and -1 for all other points."""
    sums: Float
    """Shape (4, 2). Sums of the weighted biases."""

    @classmethod
    def of(cls, window: int, terms: int) -> "Work":
        """Return work arrays for windows of this width and polynomials of so many terms."""
        square = window, window
        return cls(
            np.empty(square, np.bool_),
            np.zeros(square, np.bool_),
            np.empty((*square, 2)),
            np.empty((terms, *square)),
            np.empty((terms, terms + 2)),
            np.empty((*square, 2)),
            np.empty((window**2, 8)),
            np.empty(square, np.int64),
            np.empty((4, 2)),
        )


@compiled
def fit_windows(
    first: int,
    needed: float,
    surface: SurfacePoints,
    errors: Errors,
    work: Work,
    gradient: Float,
    covariance: Float,
) -> None:
    """Fit a surface by least squares to the window around each valid point of some rows.

    Parameters
    ----------
    first : int
        The first of the rows.
    needed : float
        Smallest number of points in a window.
    work : Work
        `used` must be False everywhere at the beginning.
    gradient : ndarray, shape (n, columns, 2, 2)
        Output, where a surface could be fitted: the displacement gradient, with ∂u_i/∂x_j at [i, j].
    covariance : ndarray, shape (n, columns, 4, 4)
        Output, where a surface could be fitted: covariance of the gradient's elements xx, xy, yx, yy.
    """
    reach = work.use.shape[0] // 2
    for r in range(gradient.shape[0]):
        for c in range(gradient.shape[1]):
            row, column = first + r - reach, c - reach
            if not surface.valid[first + r, c] or _choose(row, column, surface, work.use) < needed:
                continue
            # Windows that are alike have the same weights, such as all whole windows of a regular grid.
            if _differs(row, column, surface.position, work):
                _set_weights(work)
            _set_slopes(row, column, surface.vector, work, gradient[r, c])
            if errors.factors.size:
                covariance[r, c] = 0.0
                _add_covariance(row, column, errors, work, covariance[r, c])
            if errors.bias.size:
                _add_shared(row, column, errors.bias, work, covariance[r, c])


@inner
def _choose(row: int, column: int, surface: SurfacePoints, use: Mask) -> int:
    """Choose the points of the window whose first point is at `row`, `column`; return their number."""
    window, valid, seen = use.shape[0], surface.valid, -1
    if surface.number.size:
        seen = surface.number[row + window // 2, column + window // 2]
    count = 0
    for r in range(window):
        for c in range(window):
            inside = 0 <= row + r < valid.shape[0] and 0 <= column + c < valid.shape[1]
            use[r, c] = inside and valid[row + r, column + c] and (seen < 0 or surface.seen[seen, r, c])
            count += use[r, c]
    return count


@inner
def _differs(row: int, column: int, position: Float, work: Work) -> bool:
    """Return whether the window has other points, or points at other places, than the window before.

    The function puts the places into `work`.
    """
    window, differs = work.use.shape[0], False
    middle = position[row + window // 2, column + window // 2]
    x0, y0 = middle[0], middle[1]
    for r in range(window):
        for c in range(window):
            differs |= work.use[r, c] != work.used[r, c]
            work.used[r, c] = work.use[r, c]
            if work.use[r, c]:
                x, y = position[row + r, column + c, 0] - x0, position[row + r, column + c, 1] - y0
                differs |= x != work.places[r, c, 0] or y != work.places[r, c, 1]
                work.places[r, c, 0], work.places[r, c, 1] = x, y
    return differs


@inner
def _set_weights(work: Work) -> None:
    """Set the weights of the points in the slopes at the middle of a window."""
    scale = _normal_equations(work.use, work.places, work.design, work.normal)
    terms, window = work.design.shape[0], work.use.shape[0]
    _solve(work.normal, terms)
    for r in range(window):
        for c in range(window):
            for side in range(2):
                weight = 0.0
                if work.use[r, c]:
                    for m in range(terms):
                        weight += work.normal[m, terms + side] * work.design[m, r, c]
                    weight *= scale
                work.weights[r, c, side] = weight


@inner
def _set_slopes(row: int, column: int, vector: Float, work: Work, gradient: Float) -> None:
    """Set the displacement gradient (2, 2) of a window."""
    window = work.use.shape[0]
    gradient[:] = 0.0
    for r in range(window):
        for c in range(window):
            if work.use[r, c]:
                for side in range(2):
                    weight = work.weights[r, c, side]
                    gradient[0, side] += weight * vector[row + r, column + c, 0]
                    gradient[1, side] += weight * vector[row + r, column + c, 1]


@inner
def _normal_equations(use: Mask, places: Float, design: Float, normal: Float) -> float:
    """Fill the terms of the surface and the lower half of the normal matrix.

    Return the factor by which the coordinates were multiplied.
    """
    terms, window = design.shape[0], use.shape[0]
    reach = 1e-300
    for r in range(window):
        for c in range(window):
            if use[r, c]:
                reach = max(reach, abs(places[r, c, 0]), abs(places[r, c, 1]))
    # The normal equations are well conditioned if the coordinates are of the order of 1.
    scale = 1.0 / reach
    normal[:] = 0.0
    for r in range(window):
        for c in range(window):
            if use[r, c]:
                x, y = places[r, c, 0] * scale, places[r, c, 1] * scale
                design[0, r, c], design[1, r, c], design[2, r, c] = x, y, 1.0
                if terms > 3:
                    design[3, r, c], design[4, r, c], design[5, r, c] = x * x, x * y, y * y
                for i in range(terms):
                    for j in range(i + 1):
                        normal[i, j] += design[i, r, c] * design[j, r, c]
    return scale


@inner
def _solve(normal: Float, terms: int) -> None:
    """Replace the normal matrix by its Cholesky factor; append the first two columns of its inverse."""
    for i in range(terms):
        for j in range(i + 1):
            total = normal[i, j]
            for m in range(j):
                total -= normal[i, m] * normal[j, m]
            normal[i, j] = total**0.5 if i == j else total / normal[j, j]
    for side in range(terms, terms + 2):
        for i in range(terms):
            total = 1.0 if i == side - terms else 0.0
            for m in range(i):
                total -= normal[i, m] * normal[m, side]
            normal[i, side] = total / normal[i, i]
        for i in range(terms - 1, -1, -1):
            total = normal[i, side]
            for m in range(i + 1, terms):
                total -= normal[m, i] * normal[m, side]
            normal[i, side] = total / normal[i, i]


@inner
def _weigh(row: int, column: int, factors: Float, work: Work) -> None:
    """Write the products of `Noise.factors` and slope weights into `parts`, for each point of a window."""
    window = work.use.shape[0]
    for r in range(window):
        for c in range(window):
            p = r * window + c
            if not work.use[r, c]:
                work.parts[p] = 0.0
                continue
            for axis in range(2):
                for i in range(2):
                    factor = factors[row + r, column + c, i, axis]
                    for side in range(2):
                        work.parts[p, 4 * axis + 2 * i + side] = factor * work.weights[r, c, side]


@inner
def _find_clipped(row: int, column: int, errors: Errors, number: Indices) -> bool:
    """Set the numbers of the clipped points of a window; return whether there are any."""
    window, edge = number.shape[0], False
    for r in range(window):
        for c in range(window):
            inside = 0 <= row + r < errors.number.shape[0] and 0 <= column + c < errors.number.shape[1]
            number[r, c] = errors.number[row + r, column + c] if inside else -1
            edge |= number[r, c] >= 0
    return edge


@inner
def _shared(r: int, c: int, down: int, c2: int, number: Indices, clipped: Float, overlap: Float) -> float:
    """Return the correlation of the errors of two near points of a window; each subset may be clipped."""
    reach = clipped.shape[1] // 2
    if number[r + down, c2] >= 0:
        shared = clipped[number[r + down, c2], reach - down, reach + c - c2]
    elif number[r, c] >= 0:
        shared = clipped[number[r, c], reach + down, reach + c2 - c]
    else:
        shared = overlap[down, abs(c2 - c)]
    return float(shared)


@inlined
def _sums(
    r: int, c: int, window: int, edge: bool, overlap: Float, number: Indices, clipped: Float, parts: Float
) -> tuple[float, ...]:
    """Return sums of `parts` over a point and all later points, weighted by their correlation with it.

    The eight sums belong to the eight values that `parts` has for each point. The point itself counts half,
    because each pair is counted once and `_add_covariance` adds the transposed matrix.
    """
    variance = overlap[0, 0]
    if edge and number[r, c] >= 0:
        variance = clipped[number[r, c], clipped.shape[1] // 2, clipped.shape[1] // 2]
    p = r * window + c
    s0, s1, s2, s3 = parts[p, 0], parts[p, 1], parts[p, 2], parts[p, 3]
    s4, s5, s6, s7 = parts[p, 4], parts[p, 5], parts[p, 6], parts[p, 7]
    h = 0.5 * variance
    s0, s1, s2, s3, s4, s5, s6, s7 = h * s0, h * s1, h * s2, h * s3, h * s4, h * s5, h * s6, h * s7
    # Subsets that are farther apart do not overlap, so clipped ones do not either.
    down_most, across_most = min(window, overlap.shape[0]), min(window, overlap.shape[1])
    for down in range(min(window - r, down_most)):
        start = c + 1 if down == 0 else max(0, c - across_most + 1)
        for c2 in range(start, min(window, c + across_most)):
            q = (r + down) * window + c2
            shared = overlap[down, abs(c2 - c)] if not edge else 0.0
            if edge:
                shared = _shared(r, c, down, c2, number, clipped, overlap)
            s0 += shared * parts[q, 0]
            s1 += shared * parts[q, 1]
            s2 += shared * parts[q, 2]
            s3 += shared * parts[q, 3]
            s4 += shared * parts[q, 4]
            s5 += shared * parts[q, 5]
            s6 += shared * parts[q, 6]
            s7 += shared * parts[q, 7]
    return s0, s1, s2, s3, s4, s5, s6, s7


@inner
def _add_covariance(row: int, column: int, errors: Errors, work: Work, covariance: Float) -> None:
    """Add the covariance (4, 4) of the slopes of a window, whose points have correlated errors."""
    window = work.use.shape[0]
    _weigh(row, column, errors.factors, work)
    edge = errors.number.size > 0 and _find_clipped(row, column, errors, work.number)
    for r in range(window):
        for c in range(window):
            if not work.use[r, c]:
                continue
            sums = _sums(r, c, window, edge, errors.overlap, work.number, errors.clipped, work.parts)
            p = r * window + c
            for m in range(4):
                for n in range(4):
                    covariance[m, n] += work.parts[p, m] * sums[n] + work.parts[p, 4 + m] * sums[4 + n]
    for m in range(4):
        for n in range(m + 1):
            total = covariance[m, n] + covariance[n, m]
            covariance[m, n] = covariance[n, m] = total


@inner
def _add_shared(row: int, column: int, bias: Float, work: Work, covariance: Float) -> None:
    """Add the covariance (4, 4) of the slopes that shared errors cause, such as the interpolation bias."""
    window, sums = work.use.shape[0], work.sums
    sums[:] = 0.0
    for r in range(window):
        for c in range(window):
            if work.use[r, c]:
                for i in range(2):
                    for side in range(2):
                        weight = work.weights[r, c, side]
                        sums[2 * i + side, 0] += weight * bias[row + r, column + c, i, 0]
                        sums[2 * i + side, 1] += weight * bias[row + r, column + c, i, 1]
    for m in range(4):
        for n in range(4):
            covariance[m, n] += sums[m, 0] * sums[n, 0] + sums[m, 1] * sums[n, 1]
