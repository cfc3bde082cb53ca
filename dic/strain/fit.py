"""Displacement gradients of surfaces fitted by least squares, and the covariances of these gradients.

A fitted gradient is a weighted sum of displacements, so its error is the same weighted sum of their errors.
The correlation between overlapping subsets is included: n points with overlapping subsets average out less
noise than n independent measurements.
"""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from dic.strain.displacement import Displacement, Noise
from dic.typing import Float, Mask

# Least share of valid points in a window.
_MIN_WINDOW_SHARE = 0.5
# Windows are fitted in batches whose arrays have about this number of elements.
_TERMS_IN_MEMORY = 4_000_000


def mean_gradient(displacement: Displacement, use: Mask) -> tuple[Float, Float | None] | None:
    """Return the gradient of the affine displacement that fits the points best, and its covariance.

    Parameters
    ----------
    displacement : Displacement
    use : ndarray of bool, shape (rows, columns)
        The points to fit.

    Returns
    -------
    gradient : ndarray, shape (2, 2)
        ∂u_i/∂x_j at [i, j].
    covariance : ndarray, shape (4, 4), or None
        Covariance of the gradient's elements xx, xy, yx, yy; None if the displacements' errors are not known.

    The function returns None if there are fewer than three points or if all lie on one line.
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
    """Return the gradient (2, 2), ∂u_i/∂x_j at [i, j], of an affine function fitted to `values` (n, 2)."""
    centred = position - position.mean(axis=0)
    return np.asarray(np.linalg.solve(centred.T @ centred, centred.T @ values).T)


def gradient_weights(position: Float) -> Float:
    """Return the weights of displacements at `position` (n, 2) in the gradient that `mean_gradient` fits.

    Returns
    -------
    ndarray, shape (n, 2, 4)
        Weights of both components of each displacement in the gradient's elements xx, xy, yx, yy.
    """
    centred = position - position.mean(axis=0)
    slopes = np.linalg.solve(centred.T @ centred, centred.T)
    return np.asarray(np.einsum("ik,jn->nikj", np.eye(2), slopes).reshape(len(position), 2, 4))


def covariance_of_sums(weights: Float, noise: Noise) -> Float:
    """Return the covariance (p, p) of p weighted sums of the displacements of a grid of points.

    Parameters
    ----------
    weights : ndarray, shape (rows, columns, 2, p)
        Weights of both components of each displacement in each sum; 0 for points that are not used.
    noise : Noise
        Errors of the displacements.
    """
    from scipy.signal import fftconvolve

    parts = np.einsum("rcia,rcip->rcpa", noise.factors, weights)
    parts = np.where((weights != 0.0).any(axis=(2, 3))[..., None, None], parts, 0.0)
    around = np.pad(noise.overlap, [(n - 1, 0) for n in noise.overlap.shape], mode="reflect")
    shared = fftconvolve(parts, around[..., None, None], mode="same", axes=(0, 1))
    return np.asarray(np.einsum("rcpa,rcqa->pq", parts, shared))


def fitted_gradients(displacement: Displacement, window: int, degree: int) -> tuple[Float, Float | None]:
    """Return at every point the gradient of the surface that fits the window of points around it best.

    Parameters
    ----------
    displacement : Displacement
    window : int
        Odd width of the window, points. At least half of its points must be valid.
    degree : int
        Degree of the surface, 1 or 2.

    Returns
    -------
    gradient : ndarray, shape (rows, columns, 2, 2)
        ∂u_i/∂x_j at [i, j]; NaN where too few points of the window are valid.
    covariance : ndarray, shape (rows, columns, 4, 4), or None
        As for `mean_gradient`, at every point.
    """
    noise, shape, places = displacement.noise, displacement.valid.shape, window**2
    position, vector = _windows(displacement.position, window), _windows(displacement.vector, window)
    valid = _windows(displacement.valid.astype(np.float64), window) == 1.0
    gradient = np.full((*shape, 2, 2), np.nan)
    covariance = None if noise is None else np.full((*shape, 4, 4), np.nan)
    # Points on two lines do not determine a quadratic surface; two lines have at most two points in each row.
    needed = max(_MIN_WINDOW_SHARE * places, 2 * window + 1 if degree == 2 else 0)
    fits = np.flatnonzero(displacement.valid & (valid.sum(axis=(-1, -2)) >= needed))
    for some in np.array_split(fits, 1 + fits.size * places * 8 // _TERMS_IN_MEMORY):
        at = np.unravel_index(some, shape)
        use = valid[at].reshape(-1, places)
        offset = position[at].reshape(-1, 2, places) - displacement.position[at][:, :, None]
        weights = _slope_weights(offset, use, degree)
        moved = np.where(use[:, None], vector[at].reshape(-1, 2, places), 0.0)
        gradient[at] = moved @ np.swapaxes(weights, 1, 2)
        if noise is not None and covariance is not None:
            factors = _windows(noise.factors, window)[at].reshape(-1, 2, 2, places)
            factors = np.where(use[:, None, None], factors, 0.0)
            covariance[at] = _covariances(weights, factors, _overlap_in_window(noise.overlap, window))
    return gradient, covariance


def _windows(values: Float, window: int) -> Float:
    """Return a view of the window around each point, (rows, columns, …, window, window), with NaN outside."""
    border = [(window // 2, window // 2)] * 2 + [(0, 0)] * (values.ndim - 2)
    padded = np.pad(values, border, constant_values=np.nan)
    return sliding_window_view(padded, (window, window), axis=(0, 1))


def _slope_weights(offset: Float, use: Mask, degree: int) -> Float:
    """Return the weights (n, 2, places) of n windows' values in the surface's two slopes at the middle.

    `offset` (n, 2, places) are the positions relative to the middle of each window. `use` (n, places) is True
    at the places to which the surface is fitted.
    """
    known = np.where(use[:, None], offset, 0.0)
    # Coordinates of the order of 1 keep the normal equations well conditioned.
    scale = np.abs(known).max(initial=1e-300)
    x, y = known[:, 0] / scale, known[:, 1] / scale
    terms = [x, y, np.ones_like(x)] + ([x * x, x * y, y * y] if degree == 2 else [])
    design = np.where(use[:, None], np.stack(terms, axis=1), 0.0)
    normal = design @ np.swapaxes(design, 1, 2)
    return np.asarray(np.linalg.solve(normal, design)[:, :2] / scale)


def _covariances(weights: Float, factors: Float, overlap: Float) -> Float:
    """Return the covariances (n, 4, 4) of the gradients of n windows, whose points have correlated errors.

    `weights` is (n, 2, places), `factors` (n, 2, 2, places), `overlap` (places, places).
    """
    n, _, places = weights.shape
    total = np.zeros((n, 4, 4))
    for axis in (0, 1):
        parts = (factors[:, :, axis, None] * weights[:, None]).reshape(n, 4, places)
        # One large matrix product is many times faster than n small ones.
        shared = (parts.reshape(4 * n, places) @ overlap).reshape(n, 4, places)
        total += parts @ np.swapaxes(shared, 1, 2)
    return total


def _overlap_in_window(overlap: Float, window: int) -> Float:
    """Return the correlations of the errors at all places of a window, shape (places, places)."""
    known = np.zeros((window, window))
    rows, columns = (min(window, n) for n in overlap.shape)
    known[:rows, :columns] = overlap[:rows, :columns]
    row, column = (axis.ravel() for axis in np.mgrid[:window, :window])
    return np.asarray(known[np.abs(row[:, None] - row), np.abs(column[:, None] - column)])
