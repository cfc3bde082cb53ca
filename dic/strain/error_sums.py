"""Sums over the errors of all points, compiled."""

from dic.correlation.kernel.jit import compiled
from dic.typing import Float


@compiled
def add_products(one: Float, other: Float, sums: Float) -> None:
    """Add the products of two arrays: "nap,naq->pq" in the notation of `numpy.einsum`.

    `sums`, shape (p, p): input and output. `one` and `other` have the shape (n, 2, p).
    """
    for n in range(one.shape[0]):
        for a in range(2):
            for p in range(one.shape[2]):
                for q in range(one.shape[2]):
                    sums[p, q] += one[n, a, p] * other[n, a, q]


@compiled
def add_products_of_near(parts: Float, overlap: Float, rows: int, around: Float, sums: Float) -> None:
    """Add the products of the parts of each point and of the points after it, times their correlation.

    Points after a point are those of later rows, and later ones of the same row. A point itself counts half.
    So the sums and their transpose together are the covariance. `parts`, shape (rows, columns, 2, p).
    `overlap`: `Noise.overlap`. `rows`: number of rows whose points are added. `around`, shape (2, p): is
    overwritten. `sums`, shape (p, p): input and output.
    """
    down, right = overlap.shape
    for row in range(rows):
        for column in range(parts.shape[1]):
            here = parts[row, column]
            for a in range(2):
                for p in range(parts.shape[3]):
                    around[a, p] = 0.5 * overlap[0, 0] * here[a, p]
            for i in range(min(down, parts.shape[0] - row)):
                first = column + 1 if i == 0 else max(0, column - right + 1)
                for there in range(first, min(column + right, parts.shape[1])):
                    shared = overlap[i, abs(there - column)]
                    for a in range(2):
                        for p in range(parts.shape[3]):
                            around[a, p] += shared * parts[row + i, there, a, p]
            for a in range(2):
                for p in range(parts.shape[3]):
                    for q in range(parts.shape[3]):
                        sums[p, q] += here[a, p] * around[a, q]


@compiled
def set_weighted(factors: Float, weights: Float, parts: Float) -> None:
    """Set the parts of sums that each point's errors cause: "nia,nip->nap" in the notation of `numpy.einsum`.

    `factors`, shape (n, 2, 2): `Noise.factors` of each point, which may be NaN for points without weights.
    `weights`, shape (n, 2, p): weights of each displacement in the sums. `parts`, shape (n, 2, p): output; 0
    for points whose weights are all 0.
    """
    for n in range(weights.shape[0]):
        used = False
        for i in range(2):
            for p in range(weights.shape[2]):
                used |= weights[n, i, p] != 0.0
        for a in range(2):
            for p in range(weights.shape[2]):
                parts[n, a, p] = 0.0
                if used:
                    parts[n, a, p] = factors[n, 0, a] * weights[n, 0, p] + factors[n, 1, a] * weights[n, 1, p]


@compiled
def add_weighted(errors: Float, weights: Float, sums: Float) -> None:
    """Add errors that all points share, with the weights of the points: "nia,nip->pa" as in `numpy.einsum`.

    `errors`, shape (n, 2, 2): `Noise.bias` of each point, which may be NaN for points without weights.
    `weights`, shape (n, 2, p): weights of each displacement in the sums. `sums`, shape (p, 2): input and
    output.
    """
    for n in range(weights.shape[0]):
        for i in range(2):
            for p in range(weights.shape[2]):
                weight = weights[n, i, p]
                if weight != 0.0:
                    sums[p, 0] += weight * errors[n, i, 0]
                    sums[p, 1] += weight * errors[n, i, 1]
