"""Sums over the errors of all points, compiled. Each sum has the order of terms that `numpy.einsum` has."""

from dic.correlation.kernel.jit import compiled
from dic.typing import Float


@compiled
def add_products(one: Float, other: Float, sums: Float) -> None:
    """Add the products of two arrays: "npa,nqa->pq" in the notation of `numpy.einsum`.

    `sums`, shape (p, p): input and output. `one` and `other` have the shape (n, p, a).
    """
    for n in range(one.shape[0]):
        for p in range(one.shape[1]):
            for q in range(one.shape[1]):
                total = 0.0
                for a in range(one.shape[2]):
                    total += one[n, p, a] * other[n, q, a]
                sums[p, q] += total


@compiled
def set_weighted(factors: Float, weights: Float, parts: Float) -> None:
    """Set the parts of sums that each point's errors cause: "nia,nip->npa" in the notation of `numpy.einsum`.

    `factors`, shape (n, 2, 2): `Noise.factors` of each point, which may be NaN for points without weights.
    `weights`, shape (n, 2, p): weights of each displacement in the sums. `parts`, shape (n, p, 2): output; 0
    for points whose weights are all 0.
    """
    for n in range(weights.shape[0]):
        used = False
        for each in weights[n].flat:
            used |= each != 0.0
        for p in range(weights.shape[2]):
            for a in range(2):
                total = 0.0
                if used:
                    total += factors[n, 0, a] * weights[n, 0, p]
                    total += factors[n, 1, a] * weights[n, 1, p]
                parts[n, p, a] = total


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
