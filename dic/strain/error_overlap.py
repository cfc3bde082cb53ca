"""Correlation between the errors of points whose subsets share pixels.

The displacement of a subset is the value of its fitted shape function at the centre. So the displacement of a
subset is a weighted sum over the pixels of the subset. An affine shape function gives all pixels of a whole
subset the same weight; a quadratic shape function gives more weight to the pixels in the middle. The
correlation between two subsets is a sum over the pixels that both share. At each shared pixel, the weights of
both subsets are multiplied. The grey level gradients would change the weights too; this module assumes that
the texture is uniform.

An edge of the region, such as a crack, clips subsets. A clipped subset extrapolates its shape function to the
centre, so its pixels have very different weights. With the weights of whole subsets, the stated standard
deviation of local strain beside a crack would be up to a quarter too small. The mean strain of a region needs
no such correction: the weights of whole subsets make its standard deviation 0 to 10 % too large.
"""

from functools import cache, lru_cache

import numpy as np

from dic.correlation.settings import CorrelationSettings
from dic.image.point_grid import PointGrid, connected_part
from dic.strain.convolution import convolved
from dic.typing import Float, Grey, Indices, Mask

_PIXELS_IN_MEMORY = 16_000_000
"""Weights of clipped subsets are computed for about this number of pixels at a time."""

_PIXELS_IN_FLOAT64 = 1_000_000
"""Number of these pixels that are converted to float64 at a time."""

_CACHED = 4
"""Number of references whose clipped subsets are kept for further images."""


def error_overlap(settings: CorrelationSettings) -> Float:
    """Return the correlation between the errors of two points of interest, as a function of their distance.

    Result, shape (m, m): element [i, j] is the correlation for points with whole subsets that are i rows and
    j columns apart; element [0, 0] is 1. Subsets that are m or more rows or columns apart do not overlap.
    """
    return _overlap(settings.subset_px, settings.step_px, settings.shape)


@cache
def _overlap(n: int, step_px: int, shape: str) -> Float:
    """Compute `error_overlap` for subsets of `n` px once, because it is equal for all images of a series."""
    weights = _weights(np.ones((1, n, n), np.bool_), shape)[0]
    overlap = convolved(weights, weights)[n - 1 :: step_px, n - 1 :: step_px]
    overlap.flags.writeable = False
    return overlap


def _weights(used: Mask, shape: str) -> Grey:
    """Return the weights of the pixels in the displacements of k subsets; the sum of their squares is 1.

    The argument `used`, shape (k, n, n), is True for the pixels that a subset uses.
    """
    k, n = used.shape[:2]
    x, y = (axis.ravel() for axis in np.meshgrid(np.linspace(-1, 1, n), np.linspace(-1, 1, n)))
    terms = np.stack([np.ones(n * n), x, y] + ([x * x, x * y, y * y] if shape == "quadratic" else []))
    t, flat = len(terms), used.reshape(k, n * n).astype(np.float32)
    # A subset uses 40 % of its pixels or more. No curve of second degree runs through so many pixels, so no
    # matrix is singular.
    products = (terms[:, None] * terms).reshape(t * t, n * n)
    # Rounding errors of float32 in the sums would change correlations by 1e-4. So convert some subsets at a
    # time to float64, because all of them would need twice the memory.
    parts = np.array_split(flat, 1 + flat.size // _PIXELS_IN_FLOAT64)
    normal = np.concatenate([part @ products.T for part in parts]).reshape(k, t, t)
    coefficients = np.linalg.solve(normal, np.broadcast_to(np.eye(t)[:, :1], (k, t, 1)))[..., 0]
    weights = (coefficients.astype(np.float32) @ terms.astype(np.float32)) * flat
    # The sum of the squares of a fit's weights is an element of the inverse of its normal matrix.
    weights /= np.sqrt(coefficients[:, :1]).astype(np.float32)
    return np.asarray(weights.reshape(k, n, n))


class ClippedSubsets:
    """Correlations between the errors of points with clipped subsets and of the points around them.

    `grid` has the points, and the pixels that their subsets use. The attribute `numbers`, shape (rows,
    columns), has the indices of clipped points in `correlations`; -1 for other points.
    """

    def __init__(self, grid: PointGrid, settings: CorrelationSettings) -> None:
        self._grid, self._settings = grid, settings
        self._rows, self._columns = np.nonzero(grid.active & (grid.pixels < settings.subset_px**2))
        self.numbers: Indices = np.full(grid.active.shape, -1)
        self.numbers[self._rows, self._columns] = np.arange(len(self._rows))
        self._tables: dict[int, Float] = {}

    def __repr__(self) -> str:
        return f"ClippedSubsets({len(self._rows)} of {int(self._grid.active.sum())} subsets)"

    def numbers_around(self, rows: Indices, columns: Indices, reach: int) -> Indices:
        """Return the numbers of the clipped points around n points, shape (n, 2 reach + 1, 2 reach + 1).

        A number is the index of a point in `correlations`. The number is -1 where the subset is whole or
        absent.
        """
        padded = np.pad(self.numbers, reach, constant_values=-1)
        offset = np.arange(2 * reach + 1)
        return np.asarray(padded[rows[:, None, None] + offset[:, None], columns[:, None, None] + offset])

    def correlations(self, reach: int) -> Float:
        """Return the correlations between each clipped point and the points around it.

        `reach`: largest distance in rows and in columns of the grid.

        Result, shape (clipped points, 2 reach + 1, 2 reach + 1): element [k, reach + i, reach + j] is the
        correlation between the errors of the k-th clipped point and of the point i rows below and j columns
        to the right of it.
        """
        if reach not in self._tables:
            self._tables[reach] = self._correlated(reach)
        return self._tables[reach]

    def _correlated(self, reach: int) -> Float:
        n, total = self._settings.subset_px, len(self._rows)
        offset = np.arange(-reach, reach + 1)
        table = np.zeros((total, len(offset), len(offset)))
        for chunk in np.array_split(np.arange(total), 1 + total * n * n // _PIXELS_IN_MEMORY):
            others = self.numbers_around(self._rows[chunk], self._columns[chunk], reach)
            # Clipped points are numbered row by row. So the numbers of all points from the chunk's first row
            # to the last row that shares pixels with the chunk follow one another.
            last = int(np.searchsorted(self._rows, self._rows[chunk[-1]] + reach, side="right"))
            weights = _weights(self._used(range(int(chunk[0]), last)), self._settings.shape)
            table[chunk] = np.where(others < 0, self._with_whole(weights[: len(chunk)], offset), table[chunk])
            self._put_with_clipped(table, int(chunk[0]), others, weights)
        return table

    def _with_whole(self, weights: Grey, offset: Indices) -> Float:
        """Return the correlations between clipped subsets and the whole subsets around them."""
        n, step = self._settings.subset_px, self._settings.step_px
        whole = _weights(np.ones((1, n, n), np.bool_), self._settings.shape)[0]
        shared = np.zeros((len(weights), len(offset), len(offset)))
        for i, down in enumerate(offset * step):
            # Take one row of places at a time, because many places of large subsets would fill the memory.
            around = np.zeros((len(offset), n, n), np.float32)
            for j, right in enumerate(offset * step):
                around[j, _part(n, down), _part(n, right)] = whole[_part(n, -down), _part(n, -right)]
            shared[:, i] = weights.reshape(-1, n * n) @ around.reshape(-1, n * n).T
        return shared

    def _put_with_clipped(self, table: Float, first: int, others: Indices, weights: Grey) -> None:
        """Write the correlations of clipped subsets with other clipped subsets into the table.

        The first point of the chunk has the number `first`. The array `others` has the numbers of the points
        around each point of the chunk, and `weights` has the weights of all points from the number `first`
        on.
        """
        n, step, reach = self._settings.subset_px, self._settings.step_px, table.shape[1] // 2
        # A correlation belongs to both points of a pair. So half of the offsets are enough.
        for down, right in np.argwhere(np.ones(table.shape[1:]))[table[0].size // 2 :] - reach:
            here = np.flatnonzero(others[:, reach + down, reach + right] >= 0)
            there = others[here, reach + down, reach + right]
            shared = np.einsum(
                "kij,kij->k",
                weights[here, _part(n, down * step), _part(n, right * step)],
                weights[there - first, _part(n, -down * step), _part(n, -right * step)],
            )
            table[first + here, reach + down, reach + right] = shared
            table[there, reach - down, reach - right] = shared

    def _used(self, numbers: range) -> Mask:
        """Return the pixels that clipped subsets use, shape (k, n, n)."""
        grid, r = self._grid, self._settings.radius_px
        offset = np.arange(-r, r + 1)
        rows, columns = self._rows[numbers.start : numbers.stop], self._columns[numbers.start : numbers.stop]
        y, x = grid.y[rows], grid.x[columns]
        used = grid.usable[y[:, None, None] + offset[:, None], x[:, None, None] + offset]
        for k in np.flatnonzero(grid.cut[rows, columns]):
            used[k] = connected_part(grid.usable, int(x[k]), int(y[k]), r)
        return np.asarray(used, np.bool_)


def _part(n: int, shift_px: int) -> slice:
    """Return the part of a subset of `n` px that a second subset, shifted by `shift_px`, covers."""
    return slice(max(0, shift_px), max(0, n + min(0, shift_px)))


@lru_cache(maxsize=_CACHED)
def clipped_subsets(grid: PointGrid, settings: CorrelationSettings) -> ClippedSubsets | None:
    """Return a reference's clipped subsets, which are the same for all its images; None if there is none."""
    clipped = grid.active & (grid.pixels < settings.subset_px**2)
    return ClippedSubsets(grid, settings) if clipped.any() else None
