"""Displacement gradients of surfaces fitted by least squares, and the covariances of these gradients.

A fitted gradient is a weighted sum of displacements. The error of the gradient is therefore the same weighted
sum of the errors of the displacements. The covariances include the correlation between overlapping subsets.
The mean of n points with overlapping subsets has more noise than the mean of n independent measurements.
"""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from dic.strain.convolution import convolved
from dic.strain.displacement import Displacement, Noise
from dic.strain.error_sums import add_products, set_weighted
from dic.strain.window_kernel import add_covariances, add_shared, fit_slopes
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
        shape = (*use.shape, 2, 4)
        if len(position) == use.size:
            # Another array of this size would take more memory than the displacements.
            weights = gradient_weights(position).reshape(shape)
        else:
            weights = np.zeros(shape)
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
    covariance = np.zeros((weights.shape[-1], weights.shape[-1]))
    if noise.factors.any():
        covariance = _covariance_of_noise(weights, noise)
    if noise.bias is not None:
        used = (weights != 0.0).any(axis=(2, 3))
        bias = np.einsum("nia,nip->pa", noise.bias[used], weights[used])
        covariance += bias @ bias.T
    return np.asarray(covariance)


def _covariance_of_noise(weights: Float, noise: Noise) -> Float:
    """Return the part of `covariance_of_sums` that image noise causes."""
    rows, columns, _, count = weights.shape
    parts = np.empty((rows, columns, count, 2))
    factors, weights = (np.ascontiguousarray(each, np.float64) for each in (noise.factors, weights))
    set_weighted(factors.reshape(-1, 2, 2), weights.reshape(-1, 2, count), parts.reshape(-1, count, 2))
    around = np.pad(noise.overlap, [(n - 1, 0) for n in noise.overlap.shape], mode="reflect")
    shared = convolved(parts, around[..., None, None])
    # Only the middle part of the convolution belongs to points of the grid.
    for axis in (0, 1):
        first = noise.overlap.shape[axis] - 1
        shared = shared.take(range(first, first + parts.shape[axis]), axis)
    sums = np.zeros((count, count))
    add_products(parts.reshape(-1, count, 2), shared.reshape(-1, count, 2), sums)
    return sums


def fitted_gradients(
    displacement: Displacement, window: int, degree: int, rows: slice | None = None
) -> tuple[Float, Float | None]:
    """Fit a surface to the window of points around each point; return the displacement gradient of each fit.

    Parameters
    ----------
    displacement : Displacement
    window : int
        Width of the window, an odd number of points. At least half of the points in the window must have a
        valid displacement.
    degree : int
        Degree of the fitted surface: 1 for a plane, 2 for a quadratic surface.
    rows : slice, optional
        Limits the result to some rows of points. Their windows may contain points of other rows.

    Returns
    -------
    gradient : ndarray, shape (rows, columns, 2, 2)
        Displacement gradient at each point, with ∂u_i/∂x_j at [i, j]. The gradient is NaN if the point has no
        valid displacement, or if too few points of its window have one.
    covariance : ndarray, shape (rows, columns, 4, 4), or None
        Covariance of the gradient's elements xx, xy, yx, yy at each point; None if the errors of the
        displacements are not known.
    """
    noise, places = displacement.noise, window**2
    rows = slice(0, len(displacement.valid)) if rows is None else rows
    points = np.concatenate([displacement.position, displacement.vector], axis=-1)
    valid = _windows(displacement.valid, window)[rows]
    shape = valid.shape[:2]
    gradient = np.full((*shape, 2, 2), np.nan)
    covariance = None if noise is None else np.full((*shape, 4, 4), np.nan)
    # Points on two straight lines do not determine a quadratic surface. At most 2 · window points of a window
    # lie on two lines, so require one point more.
    needed = max(_MIN_WINDOW_SHARE * places, 2 * window + 1 if degree == 2 else 0)
    fits = np.flatnonzero(displacement.valid[rows] & (valid.sum(axis=(-1, -2)) >= needed))
    for some in np.array_split(fits, 1 + fits.size * places * 8 // _TERMS_IN_MEMORY):
        at = np.stack(np.divmod(some, shape[1]), axis=-1)
        use = valid[at[:, 0], at[:, 1]]
        at[:, 0] += rows.start
        if displacement.sight is not None:
            use &= displacement.sight.neighbours(at[:, 0], at[:, 1], window)
            enough = use.sum(axis=(1, 2)) >= needed
            at, use = at[enough], use[enough]
        weights, slopes = np.empty((*use.shape, 2)), np.empty((len(at), 2, 2))
        terms = 6 if degree == 2 else 3
        design, normal = np.empty((terms, window, window)), np.empty((terms, terms + 2))
        fit_slopes(at, use, points, design, normal, weights, slopes)
        own = at[:, 0] - rows.start, at[:, 1]
        gradient[own] = slopes
        if noise is not None and covariance is not None:
            covariance[own] = _covariances(at, use, weights, noise)
    return gradient, covariance


def _windows(values: Mask, window: int) -> Mask:
    """Return a view of the values in the window around each point, (rows, columns, window, window).

    Values outside the grid of points are False.
    """
    return sliding_window_view(np.pad(values, window // 2), (window, window))


def _covariances(at: Indices, use: Mask, weights: Float, noise: Noise) -> Float:
    """Return the covariances (n, 4, 4) of the slopes of n windows; `fit_slopes` describes the arguments."""
    window = use.shape[1]
    number, clipped = np.empty((len(at), 0, 0), np.int64), np.empty((0, 0, 0))
    if noise.clipped is not None:
        number = noise.clipped.numbers_around(at[:, 0], at[:, 1], window // 2)
        clipped = noise.clipped.correlations(min(window, max(noise.overlap.shape)) - 1)
    parts, covariance = np.empty((window**2, 8)), np.zeros((len(at), 4, 4))
    add_covariances(at, use, weights, noise.factors, noise.overlap, number, clipped, parts, covariance)
    if noise.bias is not None:
        add_shared(at, use, weights, noise.bias, np.empty((4, 2)), covariance)
    return covariance
