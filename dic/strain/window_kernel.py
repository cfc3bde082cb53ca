"""Fit surfaces to windows of points, compiled: the slopes of each window, and their covariances.

`dic.strain.fit` describes the method. Each window has its own points, so nothing is shared between windows.
"""

from dic.correlation.kernel.jit import compiled, inlined, inner
from dic.typing import Float, Indices, Mask


@compiled
def fit_slopes(
    at: Indices, use: Mask, points: Float, design: Float, normal: Float, weights: Float, gradient: Float
) -> None:
    """Fit a surface to the points of each window by least squares.

    Parameters
    ----------
    at : ndarray of int, shape (n, 2)
        Row and column of the point in the middle of each window.
    use : ndarray of bool, shape (n, window, window)
        True for the points to which the surface is fitted.
    points : ndarray, shape (rows, columns, 4)
        Position and displacement of each point. Values are needed only where `use` is True.
    design : ndarray, shape (terms, window, window)
        Work array, which each window overwrites with the terms of the fitted polynomial at its points.
        3 terms (x, y, 1) give a plane; 6 terms (also x², xy, y²) give a quadratic surface.
    normal : ndarray, shape (terms, terms + 2)
        Work array for the normal equations of a window.
    weights : ndarray, shape (n, window, window, 2)
        Output: weight of each point's displacement in the two slopes at the middle; 0 where `use` is False.
    gradient : ndarray, shape (n, 2, 2)
        Output: the displacement gradient, with ∂u_i/∂x_j at [i, j].
    """
    terms, window = design.shape[0], use.shape[1]
    for k in range(at.shape[0]):
        row, column = at[k, 0] - window // 2, at[k, 1] - window // 2
        scale = _normal_equations(use[k], points, row, column, design, normal)
        _solve(normal, terms)
        gradient[k] = 0.0
        for r in range(window):
            for c in range(window):
                for side in range(2):
                    weight = 0.0
                    if use[k, r, c]:
                        for m in range(terms):
                            weight += normal[m, terms + side] * design[m, r, c]
                        weight *= scale
                        gradient[k, 0, side] += weight * points[row + r, column + c, 2]
                        gradient[k, 1, side] += weight * points[row + r, column + c, 3]
                    weights[k, r, c, side] = weight


@inner
def _normal_equations(use: Mask, points: Float, row: int, column: int, design: Float, normal: Float) -> float:
    """Fill the terms of the surface and the lower half of the normal matrix.

    Return the factor by which the coordinates were multiplied.
    """
    terms, window = design.shape[0], use.shape[0]
    x0, y0 = (
        points[row + window // 2, column + window // 2, 0],
        points[row + window // 2, column + window // 2, 1],
    )
    reach = 1e-300
    for r in range(window):
        for c in range(window):
            if use[r, c]:
                x, y = points[row + r, column + c, 0] - x0, points[row + r, column + c, 1] - y0
                reach = max(reach, abs(x), abs(y))
    # The normal equations are well conditioned if the coordinates are of the order of 1.
    scale = 1.0 / reach
    normal[:] = 0.0
    for r in range(window):
        for c in range(window):
            if use[r, c]:
                x = (points[row + r, column + c, 0] - x0) * scale
                y = (points[row + r, column + c, 1] - y0) * scale
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
def _weigh(use: Mask, weights: Float, factors: Float, row: int, column: int, parts: Float) -> None:
    """Write the products of `Noise.factors` and slope weights into `parts`, for each point of a window."""
    window = use.shape[0]
    for r in range(window):
        for c in range(window):
            for axis in range(2):
                for i in range(2):
                    for side in range(2):
                        part = 0.0
                        if use[r, c]:
                            part = factors[row + r, column + c, i, axis] * weights[r, c, side]
                        parts[r * window + c, 4 * axis + 2 * i + side] = part


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
    because each pair is counted once and `add_covariances` adds the transposed matrix.
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


@compiled
def add_covariances(
    at: Indices,
    use: Mask,
    weights: Float,
    factors: Float,
    overlap: Float,
    number: Indices,
    clipped: Float,
    parts: Float,
    covariance: Float,
) -> None:
    """Add the covariance of the slopes of each window, whose points have correlated errors.

    Parameters
    ----------
    at, use, weights
        As for `fit_slopes`.
    factors : ndarray, shape (rows, columns, 2, 2)
        `Noise.factors`.
    overlap : ndarray, shape (m, n)
        `Noise.overlap`.
    number : ndarray of int, shape (n, window, window) or (n, 0, 0)
        Number of each point with a clipped subset, and -1 for all other points. The array has no elements if
        no subset is clipped.
    clipped : ndarray, shape (clipped points, 2 reach + 1, 2 reach + 1)
        `ClippedSubsets.correlations`, for at least the points of the window whose subsets overlap.
    parts : ndarray, shape (window², 8)
        Work array for the weighted factors of each point of a window.
    covariance : ndarray, shape (n, 4, 4)
        Input and output: covariance of the gradient's elements xx, xy, yx, yy.
    """
    window = use.shape[1]
    for k in range(at.shape[0]):
        row, column = at[k, 0] - window // 2, at[k, 1] - window // 2
        _weigh(use[k], weights[k], factors, row, column, parts)
        edge = False
        for each in number[k].flat:
            edge |= each >= 0
        for r in range(window):
            for c in range(window):
                if not use[k, r, c]:
                    continue
                sums = _sums(r, c, window, edge, overlap, number[k], clipped, parts)
                p = r * window + c
                for m in range(4):
                    for n in range(4):
                        covariance[k, m, n] += parts[p, m] * sums[n] + parts[p, 4 + m] * sums[4 + n]
        for m in range(4):
            for n in range(m + 1):
                total = covariance[k, m, n] + covariance[k, n, m]
                covariance[k, m, n] = covariance[k, n, m] = total


@compiled
def add_shared(at: Indices, use: Mask, weights: Float, bias: Float, sums: Float, covariance: Float) -> None:
    """Add the covariance of the slopes that comes from shared errors, such as the interpolation bias.

    Parameters
    ----------
    at, use, weights
        As for `fit_slopes`.
    bias : ndarray, shape (rows, columns, 2, 2)
        `Noise.bias`.
    sums : ndarray, shape (4, 2)
        Work array, which each window overwrites.
    covariance : ndarray, shape (n, 4, 4)
        Input and output, as for `add_covariances`.
    """
    window = use.shape[1]
    for k in range(at.shape[0]):
        row, column = at[k, 0] - window // 2, at[k, 1] - window // 2
        sums[:] = 0.0
        for r in range(window):
            for c in range(window):
                if use[k, r, c]:
                    for i in range(2):
                        for side in range(2):
                            weight = weights[k, r, c, side]
                            sums[2 * i + side, 0] += weight * bias[row + r, column + c, i, 0]
                            sums[2 * i + side, 1] += weight * bias[row + r, column + c, i, 1]
        for m in range(4):
            for n in range(4):
                covariance[k, m, n] += sums[m, 0] * sums[n, 0] + sums[m, 1] * sums[n, 1]
