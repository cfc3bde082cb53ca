"""Weighted sums of smooth functions of position over many points, from their values at a few nodes.

A smooth function is the polynomial that runs through its values at the nodes of Chebyshev's polynomials, up
to a tiny error. So a weighted sum of its values at all points is a sum of its values at the nodes, whose
weights follow from the positions and weights of the points, and not from the function. They are computed
once for many functions. The functions of the corrections are polynomials of up to third degree, and
projections that differ little from them: the error of their sums is below 1e-9 of the largest value.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np

from dic.image.threads import bands_of
from dic.typing import Float

_ALONG = 7
"""Number of nodes along each axis."""

_SOME_POINTS = 4096
"""Number of points whose weights are moved to the nodes at a time."""


@dataclass(frozen=True)
class Nodes:
    """Nodes over an area of points, with the weights that give the same sums as the points."""

    at: Float
    """Shape (k, 2). Positions of the nodes."""
    weights: Float
    """Shape (k, …). Weights of the nodes, in place of those of the points."""
    share: Float
    """Shape (k,). Weights of the nodes for the mean over the points."""

    @classmethod
    def of(cls, position: Float, weights: Float) -> "Nodes":
        """Return the nodes for points at `position` (n, 2) with `weights` (n, …)."""
        low, high = position.min(axis=0), position.max(axis=0)
        middle, half = (low + high) / 2, np.maximum((high - low) / 2, np.finfo(float).tiny)
        places, inverse = _chebyshev()
        flat = weights.reshape(len(weights), -1)
        moved, share = np.zeros((_ALONG**2, flat.shape[1])), np.zeros(_ALONG**2)
        for some in bands_of(len(position), _SOME_POINTS):
            x, y = (_polynomials(t) @ inverse for t in ((position[some] - middle) / half).T)
            values = (x[:, :, None] * y[:, None, :]).reshape(len(x), -1)
            moved += values.T @ flat[some]
            share += values.sum(axis=0)
        at = np.stack(np.meshgrid(places, places, indexing="ij"), axis=-1).reshape(-1, 2)
        return cls(middle + half * at, moved.reshape(-1, *weights.shape[1:]), share / len(position))


@cache
def _chebyshev() -> tuple[Float, Float]:
    """Return the nodes in (-1, 1), and the matrix from polynomials to those that are 1 at one node only."""
    places = np.cos(np.pi * (np.arange(_ALONG) + 0.5) / _ALONG)
    return places, np.asarray(np.linalg.inv(_polynomials(places)))


def _polynomials(t: Float) -> Float:
    return np.asarray(np.polynomial.chebyshev.chebvander(t, _ALONG - 1), np.float64)
