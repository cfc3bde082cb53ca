"""Fits of windows are compared with explicit matrices of the least-squares fit and of all errors."""

from types import SimpleNamespace

import numpy as np
import pytest

from dic.strain.displacement import Displacement, Noise
from dic.strain.fit import fitted_gradients

ROWS, COLUMNS = 9, 11
DOWN, ACROSS = 3, 4
"""Subsets that are so many rows or columns apart do not overlap."""


def scattered(clipped_share, seed=5):
    """Return random displacements on a grid in perspective, with missing points and different errors."""
    rng = np.random.default_rng(seed)
    row, column = np.mgrid[:ROWS, :COLUMNS].astype(float)
    depth = 1.0 + 0.01 * row - 0.02 * column
    position = np.stack([0.7 * column / depth, -0.7 * row / depth], axis=-1)
    valid = rng.random((ROWS, COLUMNS)) > 0.15
    position[~valid] = np.nan
    vector = np.where(valid[..., None], rng.normal(size=(ROWS, COLUMNS, 2)), np.nan)
    overlap = np.exp(-0.8 * np.add.outer(np.arange(float(DOWN)), np.arange(float(ACROSS))))
    numbers = np.where(rng.random((ROWS, COLUMNS)) < clipped_share, 0, -1)
    numbers[numbers == 0] = np.arange(np.count_nonzero(numbers == 0))
    factors, bias = rng.normal(size=(2, ROWS, COLUMNS, 2, 2))
    noise = Noise(factors, overlap, np.zeros((ROWS, COLUMNS, 4, 4)), bias, Clipped(numbers, rng))
    return Displacement(position, vector, valid, "mm", noise=noise)


class Clipped(SimpleNamespace):
    """Random correlations of clipped points with all points, with the methods of `ClippedSubsets`."""

    def __init__(self, numbers, rng):
        super().__init__(numbers=numbers)
        count = ROWS * COLUMNS
        some = rng.uniform(0.0, 0.5, (count, count))
        row, column = np.divmod(np.arange(count), COLUMNS)
        down, across = (np.abs(np.subtract.outer(place, place)) for place in (row, column))
        # Subsets that do not overlap share no errors.
        self.shared = np.where((down < DOWN) & (across < ACROSS), (some + some.T) / 2, 0.0)
        np.fill_diagonal(self.shared, 1.0)

    def correlations(self, reach):
        places = np.argwhere(self.numbers >= 0)
        table = np.zeros((len(places), 2 * reach + 1, 2 * reach + 1))
        for k, (row, column) in enumerate(places):
            for i in range(-reach, reach + 1):
                for j in range(-reach, reach + 1):
                    if 0 <= row + i < ROWS and 0 <= column + j < COLUMNS:
                        other = (row + i) * COLUMNS + column + j
                        table[k, reach + i, reach + j] = self.shared[row * COLUMNS + column, other]
        return table


def correlation(noise, one, other):
    """Return the correlation of the errors of two points (row, column) of the grid."""
    if max(noise.clipped.numbers[one], noise.clipped.numbers[other]) >= 0:
        return noise.clipped.shared[one[0] * COLUMNS + one[1], other[0] * COLUMNS + other[1]]
    down, across = abs(one[0] - other[0]), abs(one[1] - other[1])
    inside = down < noise.overlap.shape[0] and across < noise.overlap.shape[1]
    return noise.overlap[down, across] if inside else 0.0


def points_around(displacement, middle, half):
    """Return the valid points of the window around the point `middle`."""
    return [
        (r, c)
        for r in range(max(0, middle[0] - half), min(ROWS, middle[0] + half + 1))
        for c in range(max(0, middle[1] - half), min(COLUMNS, middle[1] + half + 1))
        if displacement.valid[r, c]
    ]


def written_out(displacement, middle, places, degree):
    """Return gradient and covariance of one window, by the pseudo-inverse and the matrix of all errors."""
    noise = displacement.noise
    x, y = (np.array([displacement.position[p] for p in places]) - displacement.position[middle]).T
    terms = [np.ones_like(x), x, y] + ([x * x, x * y, y * y] if degree == 2 else [])
    slopes = np.linalg.pinv(np.column_stack(terms))[1:3]
    # Rows xx, xy, yx, yy; columns u and v of each point.
    weights = np.kron(np.eye(2), slopes)
    values = np.array([displacement.vector[p] for p in places])
    factors = np.concatenate([np.array([noise.factors[p][i] for p in places]) for i in range(2)])
    shared = np.array([[correlation(noise, p, q) for q in places] for p in places])
    errors = (factors @ factors.T) * np.tile(shared, (2, 2))
    bias = weights @ np.concatenate([np.array([noise.bias[p][i] for p in places]) for i in range(2)])
    return (slopes @ values).T, weights @ errors @ weights.T + bias @ bias.T


@pytest.mark.parametrize(("window", "degree"), [(3, 1), (5, 1), (7, 1), (5, 2), (7, 2)])
@pytest.mark.parametrize("clipped_share", [0.0, 0.3])
def test_gradient_and_covariance_are_those_of_matrices_written_out(window, degree, clipped_share):
    displacement = scattered(clipped_share)
    gradient, covariance = fitted_gradients(displacement, window, degree)
    needed = max(0.5 * window**2, 2 * window + 1 if degree == 2 else 0)
    fitted = 0
    for middle in np.ndindex(ROWS, COLUMNS):
        places = points_around(displacement, middle, window // 2)
        if not displacement.valid[middle] or len(places) < needed:
            assert np.isnan(gradient[middle]).all()
            assert np.isnan(covariance[middle]).all()
            continue
        fitted += 1
        expected, variance = written_out(displacement, middle, places, degree)
        scale = np.sqrt(np.outer(np.diag(variance), np.diag(variance)))
        np.testing.assert_allclose(gradient[middle], expected, rtol=0, atol=1e-9 * np.abs(expected).max())
        np.testing.assert_allclose(covariance[middle] / scale, variance / scale, rtol=0, atol=1e-9)
    assert fitted > 30


def test_wide_windows_take_only_correlations_of_subsets_that_overlap(monkeypatch):
    """The time of a wide window is then that of its points, not that of all pairs of its points."""
    asked, correlations = [], Clipped.correlations
    monkeypatch.setattr(Clipped, "correlations", lambda self, n: asked.append(n) or correlations(self, n))
    fitted_gradients(scattered(0.3), 7, 1)
    assert asked
    assert max(asked) < max(DOWN, ACROSS)


@pytest.mark.parametrize("clipped_share", [0.0, 0.3])
def test_some_rows_have_the_fits_of_all_rows(clipped_share):
    displacement = scattered(clipped_share)
    every = fitted_gradients(displacement, 5, 1)
    for rows in (slice(0, 2), slice(2, ROWS)):
        for some, whole in zip(fitted_gradients(displacement, 5, 1, rows), every, strict=True):
            assert np.isfinite(whole[rows]).any()
            np.testing.assert_array_equal(some, whole[rows])
