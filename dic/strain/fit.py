"""Displacement gradients of surfaces fitted by least squares, and the covariances of these gradients.

A fitted gradient is a weighted sum of displacements. The error of the gradient is therefore the same weighted
sum of the errors of the displacements. The covariances include the correlation between overlapping subsets.
The mean of n points with overlapping subsets has more noise than the mean of n independent measurements.
"""

from collections.abc import Iterator

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from dic.strain.convolution import convolved
from dic.strain.displacement import Displacement, Noise
from dic.typing import Float, Indices, Mask

# Smallest share of the points of a window that must be valid.
_MIN_WINDOW_SHARE = 0.5
# Windows are fitted in batches whose arrays have about this number of elements.
_TERMS_IN_MEMORY = 4_000_000


def mean_gradient(displacement: Displacement, use: Mask) -> tuple[Float, Float | None] | None:
    """Fit an affine displacement to points; return its gradient and the covariance of this gradient.

    The function returns None if there are fewer than three points, or if all points lie on one line.

    Parameters
    ----------
    displacement : Displacement
    use : ndarray of bool, shape (rows, columns)
        True for the points to which the displacement is fitted.

    Returns
    -------
    gradient : ndarray, shape (2, 2)
        Displacement gradient, with ∂u_i/∂x_j at [i, j].
    covariance : ndarray, shape (4, 4), or None
        Covariance of the gradient's elements xx, xy, yx, yy; None if the errors of the displacements are not
        known.
    """
    position, vector = displacement.position[use], displacement.vector[use]
    if len(position) < 3:
        return None
    design = np.column_stack([position - position.mean(axis=0), np.ones(len(position))])
    solution, _, rank, _ = np.linalg.lstsq(design, vector, rcond=None)
    if rank < 3:
        return None
    covariance = None
    if displacement.noise is not None:
        weights = np.zeros((*use.shape, 2, 4))
        weights[use] = gradient_weights(position)
        covariance = covariance_of_sums(weights, displacement.noise)
    return solution[:2].T, covariance


def slopes_of(position: Float, values: Float) -> Float:
    """Fit an affine function to `values` (n, 2) at `position` (n, 2) and return its gradient (2, 2).

    Element [i, j] of the gradient is the derivative ∂u_i/∂x_j.
    """
    centred = position - position.mean(axis=0)
    return np.asarray(np.linalg.solve(centred.T @ centred, centred.T @ values).T)


def gradient_weights(position: Float) -> Float:
    """Return the weight of each displacement in the gradient from `mean_gradient`.

    Parameters
    ----------
    position : ndarray, shape (n, 2)
        Reference positions of the points.

    Returns
    -------
    ndarray, shape (n, 2, 4)
        Weights of the two components of each displacement in the gradient's elements xx, xy, yx, yy.
    """
    centred = position - position.mean(axis=0)
    slopes = np.linalg.solve(centred.T @ centred, centred.T)
    return np.asarray(np.einsum("ik,jn->nikj", np.eye(2), slopes).reshape(len(position), 2, 4))


def covariance_of_sums(weights: Float, noise: Noise) -> Float:
    """Return the covariance matrix, shape (p, p), of p weighted sums of displacements on a grid of points.

    Parameters
    ----------
    weights : ndarray, shape (rows, columns, 2, p)
        Weights of the two components of each displacement in each sum; 0 for points that are not used.
    noise : Noise
        Errors of the displacements.
    """
    parts = np.einsum("rcia,rcip->rcpa", noise.factors, weights)
    parts = np.where((weights != 0.0).any(axis=(2, 3))[..., None, None], parts, 0.0)
    around = np.pad(noise.overlap, [(n - 1, 0) for n in noise.overlap.shape], mode="reflect")
    shared = convolved(parts, around[..., None, None])
    # The middle of the convolution belongs to the places of the points.
    for axis in (0, 1):
        first = noise.overlap.shape[axis] - 1
        shared = shared.take(range(first, first + parts.shape[axis]), axis)
    covariance = np.einsum("rcpa,rcqa->pq", parts, shared)
    if noise.bias is not None:
        used = (weights != 0.0).any(axis=(2, 3))
        bias = np.einsum("nia,nip->pa", noise.bias[used], weights[used])
        covariance += bias @ bias.T
    return np.asarray(covariance)


def fitted_gradients(displacement: Displacement, window: int, degree: int) -> tuple[Float, Float | None]:
    """Fit a surface to the window of points around each point; return the displacement gradient of each fit.

    Parameters
    ----------
    displacement : Displacement
    window : int
        Width of the window, an odd number of points. At least half of the points in the window must have a
        valid displacement.
    degree : int
        Degree of the fitted surface: 1 for a plane, 2 for a quadratic surface.

    Returns
    -------
    gradient : ndarray, shape (rows, columns, 2, 2)
        Displacement gradient at each point, with ∂u_i/∂x_j at [i, j]. The gradient is NaN if the point has no
        valid displacement, or if too few points of its window have one.
    covariance : ndarray, shape (rows, columns, 4, 4), or None
        Covariance of the gradient's elements xx, xy, yx, yy at each point; None if the errors of the
        displacements are not known.
    """
    noise, shape, places = displacement.noise, displacement.valid.shape, window**2
    position, vector = _windows(displacement.position, window), _windows(displacement.vector, window)
    valid = _windows(displacement.valid.astype(np.float64), window) == 1.0
    gradient = np.full((*shape, 2, 2), np.nan)
    covariance = None if noise is None else np.full((*shape, 4, 4), np.nan)
    # Points on two straight lines do not determine a quadratic surface. Two lines hold at most 2 · window
    # points of a window, so require one point more.
    needed = max(_MIN_WINDOW_SHARE * places, 2 * window + 1 if degree == 2 else 0)
    fits = np.flatnonzero(displacement.valid & (valid.sum(axis=(-1, -2)) >= needed))
    for some in np.array_split(fits, 1 + fits.size * places * 8 // _TERMS_IN_MEMORY):
        at: tuple[Indices, Indices] = divmod(some, shape[1])
        use = valid[at].reshape(-1, places)
        if displacement.sight is not None:
            use = use & displacement.sight.neighbours(at[0], at[1], window).reshape(-1, places)
            enough = use.sum(axis=1) >= needed
            at, use = (at[0][enough], at[1][enough]), use[enough]
        offset = position[at].reshape(-1, 2, places) - displacement.position[at][:, :, None]
        weights = _slope_weights(offset, use, degree)
        moved = np.where(use[:, None], vector[at].reshape(-1, 2, places), 0.0)
        gradient[at] = moved @ np.swapaxes(weights, 1, 2)
        if noise is not None and covariance is not None:
            factors = _windows(noise.factors, window)[at].reshape(-1, 2, 2, places)
            factors = np.where(use[:, None, None], factors, 0.0)
            covariance[at] = _covariances(weights, factors, _overlap_in_window(noise.overlap, window))
            for near, overlap in _overlaps_beside_edges(noise, at, window):
                covariance[at[0][near], at[1][near]] = _covariances(weights[near], factors[near], overlap)
            if noise.bias is not None:
                bias = _windows(noise.bias, window)[at].reshape(-1, 2, 2, places)
                bias = np.where(use[:, None, None], bias, 0.0)
                error = np.einsum("niap,nkp->nika", bias, weights).reshape(-1, 4, 2)
                covariance[at] += error @ np.swapaxes(error, 1, 2)
    return gradient, covariance


def _windows(values: Float, window: int) -> Float:
    """Return a view of the values in the window around each point, (rows, columns, …, window, window).

    Values outside the grid of points are NaN.
    """
    border = [(window // 2, window // 2)] * 2 + [(0, 0)] * (values.ndim - 2)
    padded = np.pad(values, border, constant_values=np.nan)
    return sliding_window_view(padded, (window, window), axis=(0, 1))


def _slope_weights(offset: Float, use: Mask, degree: int) -> Float:
    """Return the weights with which the values in a window give the slopes of the fitted surface.

    The two slopes are those at the middle of the window. The weights have the shape (n, 2, places) for n
    windows. A window has `places` points. The array `offset` (n, 2, places) holds the position of each of
    these points relative to the point in the middle of the window. The array `use` (n, places) is True for
    the points to which the surface is fitted.
    """
    known = np.where(use[:, None], offset, 0.0)
    # The normal equations are well conditioned if the coordinates are of the order of 1.
    scale = np.abs(known).max(initial=1e-300)
    x, y = known[:, 0] / scale, known[:, 1] / scale
    terms = [x, y, np.ones_like(x)] + ([x * x, x * y, y * y] if degree == 2 else [])
    design = np.where(use[:, None], np.stack(terms, axis=1), 0.0)
    normal = design @ np.swapaxes(design, 1, 2)
    return np.asarray(np.linalg.solve(normal, design)[:, :2] / scale)


def _covariances(weights: Float, factors: Float, overlap: Float) -> Float:
    """Return the covariances (n, 4, 4) of the gradients of n windows; errors of points are correlated.

    The shapes of the arguments are (n, 2, places) for `weights`, (n, 2, 2, places) for `factors`, and
    (places, places) or (n, places, places) for `overlap`.
    """
    n, _, places = weights.shape
    total = np.zeros((n, 4, 4))
    for axis in (0, 1):
        parts = (factors[:, :, axis, None] * weights[:, None]).reshape(n, 4, places)
        if overlap.ndim == 2:
            # One large matrix product is many times faster than n small ones.
            shared = (parts.reshape(4 * n, places) @ overlap).reshape(n, 4, places)
        else:
            shared = parts @ overlap
        total += parts @ np.swapaxes(shared, 1, 2)
    return total


def _overlap_in_window(overlap: Float, window: int) -> Float:
    """Return the correlations between the errors of all points of a window, shape (places, places)."""
    known = np.zeros((window, window))
    rows, columns = (min(window, n) for n in overlap.shape)
    known[:rows, :columns] = overlap[:rows, :columns]
    row, column = (axis.ravel() for axis in np.mgrid[:window, :window])
    return np.asarray(known[np.abs(row[:, None] - row), np.abs(column[:, None] - column)])


def _overlaps_beside_edges(
    noise: Noise, at: tuple[Indices, Indices], window: int
) -> Iterator[tuple[Indices, Float]]:
    """Yield indices of windows with clipped subsets, and their correlations, shape (n, places, places).

    The windows have their middles at the points `at`. They come in batches that fit into memory.
    """
    if noise.clipped is None:
        return
    number = noise.clipped.numbers_around(*at, window // 2).reshape(-1, window**2)
    table = noise.clipped.correlations(window - 1)
    whole = _overlap_in_window(noise.overlap, window)
    near = np.flatnonzero((number >= 0).any(axis=1))
    for some in np.array_split(near, 1 + near.size * window**4 // _TERMS_IN_MEMORY):
        overlap = np.repeat(whole[None], len(some), axis=0)
        for place in range(window**2):
            clipped = np.flatnonzero(number[some, place] >= 0)
            # Element [window - 1, window - 1] of a table belongs to the point itself, which is at `place`.
            up, left = window - 1 - place // window, window - 1 - place % window
            around = table[number[some[clipped], place], up : up + window, left : left + window]
            values = around.reshape(-1, window**2)
            overlap[clipped, place] = overlap[clipped, :, place] = values
        yield some, overlap
