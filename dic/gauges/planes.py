"""Planes fitted to values at points by least squares, as weights of these values."""

import numpy as np

from dic.typing import Float

FLAT = 1e-6
"""Points count as lying on one line if they reach less far across it than this fraction of their extent."""


def sums_at(position: Float, at: Float) -> Float:
    """Return the weights with which values at points give a fitted plane at a place, and its two slopes.

    Parameters
    ----------
    position : ndarray, shape (n, 2)
        Points that do not lie on one line.
    at : ndarray, shape (2,)

    Returns
    -------
    ndarray, shape (3, n)
    """
    middle = position.mean(axis=0)
    centred = position - middle
    slopes = np.linalg.solve(centred.T @ centred, centred.T)
    return np.stack([1.0 / len(position) + (at - middle) @ slopes, *slopes])


def lie_on_one_line(position: Float) -> bool:
    """Return True if points (n, 2) lie on one line, so that no plane can be fitted."""
    if len(position) < 3:
        return True
    extent = np.linalg.svd(position - position.mean(axis=0), compute_uv=False)
    return bool(extent[1] <= FLAT * extent[0])
