"""Displacement gradients of surfaces fitted by least squares, and the covariances of these gradients.

A fitted gradient is a weighted sum of displacements. The error of the gradient is therefore the same weighted
sum of the errors of the displacements. The covariances include the correlation between overlapping subsets.
The mean of n points with overlapping subsets has more noise than the mean of n independent measurements.
"""

from typing import NamedTuple

import numpy as np

from dic.strain.convolution import convolved
from dic.strain.displacement import Displacement, Noise
from dic.strain.error_sums import add_products, add_products_of_near, add_weighted, set_weighted
from dic.strain.window_kernel import Errors, SurfacePoints, Work, fit_windows
from dic.typing import Float, Mask

# Smallest share of the points of a window that must be valid.
_MIN_WINDOW_SHARE = 0.5

_NEAR = 12
"""Above this number of rows or columns with correlated errors, a Fourier transform is faster than a sum."""


class MeanGradient(NamedTuple):
    """The gradient of an affine displacement that is fitted to points."""

    gradient: Float
    """Shape (2, 2). Displacement gradient, with ∂u_i/∂x_j at [i, j]."""
    covariance: Float | None = None
    """Shape (4, 4). Covariance of the gradient's elements xx, xy, yx, yy; None if the errors of the
    displacements are not known.
    """
    by_bias: Float | None = None
    """Shape (4, 4). The part of the covariance that the interpolation bias causes."""


def mean_gradient(displacement: Displacement, use: Mask) -> MeanGradient | None:
    """Fit an affine displacement to points; return its gradient and the covariance of this gradient.

    The function returns None if there are fewer than three points, or if all points lie on one line.

    `use`, shape (rows, columns): True for the points to which the displacement is fitted.
    """
    position, vector = (
        each.reshape(-1, 2) if use.all() else each[use]
        for each in (displacement.position, displacement.vector)
    )
    if len(position) < 3:
        return None
    design = np.ones((len(position), 3))
    design[:, :2] = position - position.mean(axis=0)
    solution, _, rank, _ = np.linalg.lstsq(design, vector, rcond=None)
    gradient = np.asarray(solution[:2].T, np.float64)
    if rank < 3:
        return None
    if displacement.noise is None:
        return MeanGradient(gradient)
    shape = (*use.shape, 2, 4)
    if len(position) == use.size:
        # Another array of this size would take more memory than the displacements.
        weights = gradient_weights(position).reshape(shape)
    else:
        weights = np.zeros(shape)
        weights[use] = gradient_weights(position)
    by_noise, by_bias = _covariances_of_sums(weights, displacement.noise)
    return MeanGradient(gradient, by_noise + by_bias, by_bias)


def slopes_of(position: Float, values: Float) -> Float:
    """Fit an affine function to `values` (n, 2) at `position` (n, 2) and return its gradient (2, 2).

    Element [i, j] of the gradient is the derivative ∂u_i/∂x_j.
    """
    centred = position - position.mean(axis=0)
    return np.asarray(np.linalg.solve(centred.T @ centred, centred.T @ values).T)


def gradient_weights(position: Float) -> Float:
    """Return the weight of each displacement in the gradient from `mean_gradient`.

    `position`, shape (n, 2): reference positions of the points.

    Result, shape (n, 2, 4): weights of the two components of each displacement in the gradient's elements xx,
    xy, yx, yy.
    """
    centred = position - position.mean(axis=0)
    slopes = np.linalg.solve(centred.T @ centred, centred.T)
    weights = np.zeros((len(position), 2, 4))
    weights[:, 0, :2] = weights[:, 1, 2:] = slopes.T
    return weights


def covariance_of_sums(weights: Float, noise: Noise) -> Float:
    """Return the covariance matrix, shape (p, p), of p weighted sums of displacements on a grid of points.

    `weights`, shape (rows, columns, 2, p): weights of the two components of each displacement in each sum; 0
    for points that are not used. `noise`: errors of the displacements.
    """
    by_noise, by_bias = _covariances_of_sums(weights, noise)
    return by_noise + by_bias


def _covariances_of_sums(weights: Float, noise: Noise) -> tuple[Float, Float]:
    """Return the parts of `covariance_of_sums` that image noise and the interpolation bias cause."""
    count = weights.shape[-1]
    by_noise, by_bias = np.zeros((count, count)), np.zeros((count, count))
    weights = np.ascontiguousarray(weights, np.float64)
    if noise.factors.any():
        by_noise = _covariance_of_noise(weights, noise)
    if noise.bias is not None:
        sums, bias = np.zeros((count, 2)), np.ascontiguousarray(noise.bias, np.float64)
        add_weighted(bias.reshape(-1, 2, 2), weights.reshape(-1, 2, count), sums)
        by_bias = sums @ sums.T
    return by_noise, by_bias


def _covariance_of_noise(weights: Float, noise: Noise) -> Float:
    """Return the part of `covariance_of_sums` that image noise causes."""
    parts = parts_of_noise(weights, noise.factors)
    return products_of_near(parts, noise.overlap, slice(0, len(parts)))


def parts_of_noise(weights: Float, factors: Float) -> Float:
    """Return the part of each point's two errors in p weighted sums, shape (rows, columns, 2, p)."""
    parts, factors = np.empty(weights.shape), np.ascontiguousarray(factors, np.float64)
    flat = (-1, 2, weights.shape[-1])
    set_weighted(factors.reshape(-1, 2, 2), weights.reshape(flat), parts.reshape(flat))
    return parts


def products_of_near(parts: Float, overlap: Float, own: slice) -> Float:
    """Return the covariance by the parts of the points of some rows, with all points around them.

    `parts`: result of `parts_of_noise`. `overlap`: `Noise.overlap`.
    """
    count, reach = parts.shape[-1], overlap.shape
    sums = np.zeros((count, count))
    if max(reach) <= _NEAR:
        # Each pair of points counts once, with the first of its points.
        overlap = np.ascontiguousarray(overlap, np.float64)
        add_products_of_near(parts[own.start :], overlap, own.stop - own.start, np.empty((2, count)), sums)
        return sums + sums.T
    around = np.pad(overlap, [(n - 1, 0) for n in reach], mode="reflect")
    whole = convolved(parts, around[..., None, None])
    # Only the middle part of the convolution belongs to points of the grid.
    first = reach[0] - 1 + own.start
    shared = whole[first : first + own.stop - own.start, reach[1] - 1 : reach[1] - 1 + parts.shape[1]]
    one, other = (np.ascontiguousarray(each).reshape(-1, 2, count) for each in (parts[own], shared))
    add_products(one, other, sums)
    return sums


def fitted_gradients(
    displacement: Displacement, window: int, degree: int, rows: slice | None = None
) -> tuple[Float, Float | None]:
    """Fit a surface to the window of points around each point; return the displacement gradient of each fit.

    `window`: width of the window, an odd number of points. At least half of the points in the window must
    have a valid displacement. `degree`: degree of the fitted surface: 1 for a plane, 2 for a quadratic
    surface. `rows`: limits the result to some rows of points. Their windows may contain points of other rows.

    Returns
    -------
    gradient : ndarray, shape (rows, columns, 2, 2)
        Displacement gradient at each point, with ∂u_i/∂x_j at [i, j]. The gradient is NaN if the point has no
        valid displacement, or if too few points of its window have one.
    covariance : ndarray, shape (rows, columns, 4, 4), or None
        Covariance of the gradient's elements xx, xy, yx, yy at each point; None if the errors of the
        displacements are not known.
    """
    rows = slice(0, len(displacement.valid)) if rows is None else rows
    shape = (rows.stop - rows.start, displacement.valid.shape[1])
    gradient = np.full((*shape, 2, 2), np.nan)
    covariance = None if displacement.noise is None else np.full((*shape, 4, 4), np.nan)
    # Points on two straight lines do not determine a quadratic surface. At most 2 · window points of a window
    # lie on two lines, so require one point more.
    needed = float(max(_MIN_WINDOW_SHARE * window**2, 2 * window + 1 if degree == 2 else 0))
    fit_windows(
        rows.start,
        needed,
        _surface(displacement, window, rows),
        _errors(displacement.noise, window),
        Work.of(window, 6 if degree == 2 else 3),
        gradient,
        np.empty((0, 0, 4, 4)) if covariance is None else covariance,
    )
    return gradient, covariance


def _surface(displacement: Displacement, window: int, rows: slice) -> SurfacePoints:
    """Return the points near some rows, for the compiled fit."""
    position, vector = (
        np.ascontiguousarray(each, np.float64) for each in (displacement.position, displacement.vector)
    )
    number, seen = np.empty((0, 0), np.int64), np.empty((0, window, window), np.bool_)
    if displacement.sight is not None:
        number, seen = displacement.sight.hidden(window, rows)
    return SurfacePoints(position, vector, displacement.valid, number, seen)


def _errors(noise: Noise | None, window: int) -> Errors:
    """Return the errors of the displacements for the compiled fit.

    The fit is compiled anew for arrays of another type or layout, which takes a second or two.
    """
    none = np.empty((0, 0, 2, 2))
    number, clipped = np.empty((0, 0), np.int64), np.empty((0, 0, 0))
    if noise is None:
        return Errors(none, np.empty((0, 0)), none, number, clipped)
    if noise.clipped is not None:
        number = noise.clipped.numbers
        clipped = noise.clipped.correlations(min(window, max(noise.overlap.shape)) - 1)
    factors, overlap, bias = (
        np.require(each, np.float64, ["C", "W"])
        for each in (noise.factors, noise.overlap, none if noise.bias is None else noise.bias)
    )
    return Errors(factors, overlap, bias, number, clipped)
