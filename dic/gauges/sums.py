"""The covariance of weighted sums of the displacements of some points.

A gauge reads, to first order, a weighted sum of displacements. Points whose subsets share pixels have
correlated errors, so the variance of the sum is larger than for independent points. The interpolation bias is
common to all points.
"""

from dataclasses import replace

import numpy as np

from dic.strain.displacement import Noise
from dic.strain.fit import covariance_of_sums
from dic.typing import Float, Indices

_FEW = 300
"""Up to this number of points the matrix of all correlations is faster than Fourier transforms."""


def covariance_at_points(rows: Indices, columns: Indices, weights: Float, noise: Noise) -> Float:
    """Return the covariance, shape (p, p), of p weighted sums of the displacements of n points.

    Parameters
    ----------
    rows, columns : ndarray of int, shape (n,)
        Places of the points in the grid of points, each at most once.
    weights : ndarray, shape (n, 2, p)
        Weights of the two components of each displacement in each sum.
    noise : Noise
        Errors of the displacements of the whole grid.
    """
    if len(rows) > _FEW:
        return _by_transforms(rows, columns, weights, noise)
    parts = np.einsum("nia,nip->npa", noise.factors[rows, columns], weights)
    overlap = correlations(rows, columns, noise.overlap)
    covariance = np.einsum("npa,nqa->pq", parts, np.tensordot(overlap, parts, axes=(1, 0)))
    if noise.bias is not None:
        bias = np.einsum("nia,nip->pa", noise.bias[rows, columns], weights)
        covariance += bias @ bias.T
    return np.asarray(covariance)


def correlations(rows: Indices, columns: Indices, overlap: Float) -> Float:
    """Return the correlations between the errors of points (…, n), shape (…, n, n); see `Noise.overlap`."""
    down = np.abs(rows[..., :, None] - rows[..., None, :])
    right = np.abs(columns[..., :, None] - columns[..., None, :])
    near = (down < overlap.shape[0]) & (right < overlap.shape[1])
    return np.where(near, overlap[np.where(near, down, 0), np.where(near, right, 0)], 0.0)


def _by_transforms(rows: Indices, columns: Indices, weights: Float, noise: Noise) -> Float:
    top, left = int(rows.min()), int(columns.min())
    part = slice(top, int(rows.max()) + 1), slice(left, int(columns.max()) + 1)
    own = replace(
        noise,
        factors=noise.factors[part],
        bias=None if noise.bias is None else noise.bias[part],
        clipped=None,
    )
    on_grid = np.zeros((*own.factors.shape[:2], *weights.shape[1:]))
    on_grid[rows - top, columns - left] = weights
    return covariance_of_sums(on_grid, own)
