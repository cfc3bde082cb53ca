"""Least squares planes through values at points; a plane's value and slopes are weighted sums of values."""

import numpy as np

from dic.typing import Float, Mask

_FLAT = 1e-6
"""Points count as lying on one line if their extent across the line is below this fraction of their
extent along it."""


def sums_at(position: Float, at: Float) -> Float:
    """Return the weights of the values at n points in a fitted plane's value at `at`, and in its two slopes.

    `position`, shape (n, 2): points that do not lie on one line. `at` has the shape (2,).

    The result has the shape (3, n).
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
    return bool(extent[1] <= _FLAT * extent[0])


def sums_at_places(position: Float, valid: Mask, places: Float) -> Float:
    """Return the weights that `sums_at` gives for one place, for many places at once, shape (places, 3, m).

    `position`, shape (places, m, 2): points around each place. The points of a place that are `valid` must
    not lie on one line. `valid`, shape (places, m): the weights of other points are 0. `places` has the shape
    (places, 2).
    """
    share = valid / np.sum(valid, axis=1, keepdims=True)
    middle = np.einsum("pm,pmi->pi", share, position)
    centred = np.where(valid[..., None], position - middle[:, None], 0.0)
    slopes = np.linalg.solve(np.swapaxes(centred, 1, 2) @ centred, np.swapaxes(centred, 1, 2))
    mean = share + np.einsum("pi,pim->pm", places - middle, slopes)
    return np.concatenate([mean[:, None], slopes], axis=1)


def flat_sets(position: Float, valid: Mask) -> Mask:
    """Return True for each set of points (sets, m, 2) whose `valid` points (sets, m) lie on one line."""
    share = valid / np.maximum(1, valid.sum(axis=1, keepdims=True))
    known = np.where(valid[..., None], position, 0.0)
    centred = np.where(valid[..., None], known - np.einsum("pm,pmi->pi", share, known)[:, None], 0.0)
    least, largest = np.linalg.eigvalsh(np.swapaxes(centred, 1, 2) @ centred).T
    return np.asarray(least <= _FLAT**2 * largest)
