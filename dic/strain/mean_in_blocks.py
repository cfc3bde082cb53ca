"""The mean gradient of many points, and covariances of sums over them, computed in blocks of rows.

`dic.strain.fit.mean_gradient` needs several hundred bytes for each point, more than all displacements and
strains of a large image. Here only the points of one block of rows are in work at a time. The sums are those
of `mean_gradient`, in another order of their terms.
"""

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from dic.image.threads import bands_of
from dic.strain.displacement import Displacement, Noise
from dic.strain.error_sums import add_weighted
from dic.strain.fit import MeanGradient, parts_of_noise, products_of_near
from dic.typing import Float, Mask

MANY_POINTS = 250_000
"""Above this number of points the mean gradient is computed in blocks; 12 megapixels at a step of 7 px.

The mean gradient has four sums. Covariances of more sums are computed in blocks above fewer points.
"""

_BLOCK_POINTS = 50_000
"""Number of points of a block for four weighted sums; with more sums, a block has fewer points."""

_ON_A_LINE = 1e-12
"""Points lie on a line if their extents along and across it, squared, have a smaller ratio."""


def mean_gradient_in_blocks(displacement: Displacement, use: Mask) -> MeanGradient | None:
    """Return the result of `mean_gradient`, but compute it in blocks of rows."""
    count = int(np.count_nonzero(use))
    if count < 3:
        return None
    position, vector = displacement.position, displacement.vector
    blocks = bands_of(len(use), max(1, _BLOCK_POINTS // use.shape[1]))
    centre = np.zeros(2)
    for block in blocks:
        centre += position[block][use[block]].sum(axis=0)
    centre /= count
    normal, products = np.zeros((2, 2)), np.zeros((2, 2))
    for block in blocks:
        centred = position[block][use[block]] - centre
        normal += centred.T @ centred
        products += centred.T @ vector[block][use[block]]
    across, along = np.linalg.eigvalsh(normal)
    if across <= _ON_A_LINE * along:
        return None
    gradient = np.asarray(np.linalg.solve(normal, products).T, np.float64)
    if displacement.noise is None:
        return MeanGradient(gradient)
    weights = _Weights(position, use, centre, np.asarray(np.linalg.inv(normal), np.float64))
    by_noise, by_bias = covariances_in_blocks(weights.of, 4, displacement.noise, use.shape)
    return MeanGradient(gradient, by_noise + by_bias, by_bias)


class _Weights:
    """The weights of the displacements in the mean gradient; see `gradient_weights`."""

    def __init__(self, position: Float, use: Mask, centre: Float, inverse: Float) -> None:
        self._position, self._use, self._centre, self._inverse = position, use, centre, inverse

    def of(self, rows: slice) -> Float:
        """Return the weights of some rows of points, shape (rows, columns, 2, 4); 0 for unused points."""
        use = self._use[rows]
        weights = np.zeros((*use.shape, 2, 4))
        slopes = (self._position[rows][use] - self._centre) @ self._inverse
        weights[use, 0, :2] = weights[use, 1, 2:] = slopes
        return weights


def covariances_in_blocks(
    weights_of: Callable[[slice], Float], count: int, noise: Noise, shape: tuple[int, ...]
) -> tuple[Float, Float]:
    """Return the two parts of `dic.strain.fit.covariance_of_sums`: by image noise, and by interpolation.

    `weights_of`: function that returns the weights of some rows of points, shape (rows, columns, 2, p).
    `count`: number p of weighted sums. `shape`: number of rows and columns of points.

    Returns
    -------
    by_noise, by_bias : ndarray, shape (p, p)
    """
    blocks = bands_of(shape[0], max(1, _BLOCK_POINTS * 4 // (count * shape[1])))
    by_noise, by_bias = np.zeros((count, count)), np.zeros((count, count))
    if noise.factors.any():
        for part in _parts_of_noise(weights_of, count, noise, blocks):
            by_noise += part
    if noise.bias is not None:
        sums = np.zeros((count, 2))
        for block in blocks:
            bias = np.ascontiguousarray(noise.bias[block], np.float64)
            add_weighted(bias.reshape(-1, 2, 2), weights_of(block).reshape(-1, 2, count), sums)
        by_bias = sums @ sums.T
    return by_noise, by_bias


def _parts_of_noise(
    weights_of: Callable[[slice], Float], count: int, noise: Noise, blocks: Sequence[slice]
) -> Iterator[Float]:
    """Yield the part of the covariance that belongs to the points of each block and all points near them."""
    reach, rows = noise.overlap.shape[0], blocks[-1].stop
    for block in blocks:
        near = slice(max(0, block.start - reach + 1), min(rows, block.stop + reach - 1))
        parts = parts_of_noise(weights_of(near), noise.factors[near])
        yield products_of_near(parts, noise.overlap, slice(block.start - near.start, block.stop - near.start))
