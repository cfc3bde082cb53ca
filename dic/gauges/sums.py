"""The covariance of weighted sums of displacements.

A gauge reads, to first order, a weighted sum of displacements. Points whose subsets share pixels have
correlated errors, so the variance of the sum is larger than for independent points. The interpolation bias is
common to all points.
"""

from dataclasses import dataclass, replace

import numpy as np

from dic.strain.displacement import Noise
from dic.strain.error_overlap import ClippedSubsets
from dic.strain.fit import covariance_of_sums
from dic.typing import Float, Indices

_FEW = 300
"""Up to this number of points, the matrix of all correlations is faster than Fourier transforms."""
_FEW_OFTEN = 1000
"""The same, if the matrix is computed once and used many times."""


def covariance_at_points(
    rows: Indices, columns: Indices, weights: Float, noise: Noise, known: Float | None = None
) -> Float:
    """Return the covariance, shape (p, p), of p weighted sums of the displacements of n points.

    `rows`, `columns`, shape (n,): row and column indices of the points in the grid of points. Each point
    occurs at most once. `weights`, shape (n, 2, p): weights of the two components of each displacement in
    each sum. `noise`: errors of the displacements of the whole grid. `known`: `correlations` of the points,
    which are the same in all images, if they were computed before.
    """
    if known is None and len(rows) > _FEW:
        return _by_transforms(rows, columns, weights, noise)
    overlap = correlations(rows, columns, noise) if known is None else known
    return PointErrors.of(rows, columns, noise, overlap).covariance(weights)


@dataclass(frozen=True)
class PointErrors:
    """The errors of the displacements of n points, as they were at one image.

    Attributes
    ----------
    factors, bias : ndarray, shape (n, 2, 2)
        Those of `Noise` at the points; `bias` may be None.
    overlap : ndarray, shape (n, n)
        `correlations` of the points.
    """

    factors: Float
    bias: Float | None
    overlap: Float

    @classmethod
    def of(cls, rows: Indices, columns: Indices, noise: Noise, overlap: Float) -> "PointErrors":
        """Return the errors at points, with copies of what later images may change."""
        bias = None if noise.bias is None else noise.bias[rows, columns]
        return cls(noise.factors[rows, columns], bias, overlap)

    def covariance(self, weights: Float) -> Float:
        """Return the covariance (p, p) of p sums with weights (n, 2, p)."""
        # For few points, `einsum` would take several times as long as products of matrices.
        count, sums = len(weights), weights.shape[2]
        to_sums = np.swapaxes(weights, 1, 2)
        parts = to_sums @ self.factors
        shared = (self.overlap @ parts.reshape(count, 2 * sums)).reshape(count, sums, 2)
        one, other = (np.swapaxes(each, 0, 1).reshape(sums, 2 * count) for each in (parts, shared))
        covariance = one @ other.T
        if self.bias is not None:
            bias = (to_sums @ self.bias).sum(axis=0)
            covariance += bias @ bias.T
        return np.asarray(covariance)

    def variance(self, weights: Float) -> float:
        """Return the variance of one sum with weights (n, 2)."""
        factors = self.factors
        # A product of many small matrices would take several times as long.
        parts = weights[:, :1] * factors[:, 0] + weights[:, 1:] * factors[:, 1]
        variance = float(np.vdot(parts, self.overlap @ parts))
        if self.bias is not None:
            bias = weights.ravel() @ self.bias.reshape(-1, 2)
            variance += float(bias @ bias)
        return variance


def kept_correlations(rows: Indices, columns: Indices, noise: Noise | None, *, often: bool) -> Float | None:
    """Return the `correlations` of a gauge's points, to be used again; None for many or unknown ones.

    `often`: True if they will be used many times, so that more points are worth it.
    """
    most = _FEW_OFTEN if often else _FEW
    return None if noise is None or len(rows) > most else correlations(rows, columns, noise)


def correlations(rows: Indices, columns: Indices, noise: Noise) -> Float:
    """Return the correlations between the errors of points (…, n), shape (…, n, n).

    Subsets that an edge of the region clips have other correlations than whole subsets; see `Noise.clipped`.
    """
    overlap = noise.overlap
    down, right = (places[..., None, :] - places[..., :, None] for places in (rows, columns))
    near = (np.abs(down) < overlap.shape[0]) & (np.abs(right) < overlap.shape[1])
    down, right = np.where(near, down, 0), np.where(near, right, 0)
    known = np.where(near, overlap[np.abs(down), np.abs(right)], 0.0)
    if noise.clipped is None:
        return known
    number = noise.clipped.numbers[rows, columns]
    if (number < 0).all():
        return known
    reach = int(max(np.abs(down).max(), np.abs(right).max()))
    table = noise.clipped.correlations(reach)
    first, second = np.broadcast_arrays(number[..., :, None], number[..., None, :])
    of_first, of_second = near & (first >= 0), near & (first < 0) & (second >= 0)
    for use, numbers, sign in ((of_first, first, 1), (of_second, second, -1)):
        known[use] = table[numbers[use], reach + sign * down[use], reach + sign * right[use]]
    return known


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
    covariance = covariance_of_sums(on_grid, own)
    if noise.clipped is None:
        return covariance
    parts = np.where(
        (on_grid != 0.0).any(axis=(2, 3))[..., None, None],
        np.einsum("rcia,rcip->rcpa", own.factors, on_grid),
        0.0,
    )
    return covariance + _by_clipping(rows, columns, parts, (top, left), noise.clipped, noise.overlap)


def _by_clipping(
    rows: Indices,
    columns: Indices,
    parts: Float,
    origin: tuple[int, int],
    clipped: ClippedSubsets,
    overlap: Float,
) -> Float:
    """Return by how much clipped subsets change the covariance that whole subsets would give.

    The array `parts`, shape (…, …, p, 2), has the error of each sum by each point of the part of the grid
    that begins at `origin`.
    """
    change = np.zeros(2 * parts.shape[2:3])
    number = clipped.numbers[rows, columns]
    rows, columns, number = (each[number >= 0] for each in (rows, columns, number))
    if not number.size:
        return change
    reach = max(overlap.shape) - 1
    whole = np.zeros((reach + 1, reach + 1))
    whole[: overlap.shape[0], : overlap.shape[1]] = overlap
    offset = np.abs(np.arange(-reach, reach + 1))
    whole = whole[offset[:, None], offset]
    table = clipped.correlations(reach)
    around = np.pad(parts, [(reach, reach), (reach, reach), (0, 0), (0, 0)])
    width = 2 * reach + 1
    for row, column, own in zip(rows, columns, number, strict=True):
        i, j = row - origin[0], column - origin[1]
        near = around[i : i + width, j : j + width]
        different = table[own] - whole
        # The loop meets a pair of clipped points twice, but a pair of a clipped and a whole point once.
        (numbers,) = clipped.numbers_around(np.array([row]), np.array([column]), reach)
        of_whole = np.where(numbers < 0, different, 0.0)
        middle = parts[i, j]
        both, once = (np.einsum("pa,ijqa,ij->pq", middle, near, each) for each in (different, of_whole))
        change += both + once.T
    return change
