"""Consistency check: a correlated point is kept only if a neighbour predicts its displacement.

A subset with few speckles can match a wrong place with a good ZNCC, but neighbours do not match wrong places
consistently. A warp is also rejected if it shrinks the surface to less than half, stretches it to more than
twice, or mirrors it: real surfaces do not.
"""

import numpy as np

from dic.typing import Float, Indices, Mask

_TOLERANCE_PX, _TOLERANCE = 1.0, 0.1
"""Largest error of a prediction: so many pixels, plus this share of the distance to the neighbour."""

_LARGEST_STRETCH, _SMALLEST_STRETCH = 2.0, 0.5

_NEAREST_SEEDS = 4

_NEIGHBOURS = ((0, 1), (1, 0), (-1, 0), (1, 1), (-1, -1), (1, -1), (-1, 1))
"""Rows and columns to the neighbours on a grid except the left one, in the order in which they are tried."""


def consistent_seeds(points: Indices, warps: Float) -> Mask:
    """Return which scattered points are predicted by one of their four nearest neighbours.

    Parameters
    ----------
    points : ndarray of int, shape (n, 2)
    warps : ndarray, shape (n, 6)

    Returns
    -------
    ndarray of bool, shape (n,)
        With fewer than three plausible warps there is no neighbour to ask: then all plausible ones.
    """
    plausible = _plausible(warps.T)
    if plausible.sum() < 3:
        return np.asarray(plausible)
    offset = (points[:, None, :] - points[None, :, :]).astype(np.float64)
    distance = np.linalg.norm(offset, axis=2)
    distance[:, ~plausible] = np.inf
    np.fill_diagonal(distance, np.inf)
    place = points + warps[:, [0, 3]]
    gradients = warps[:, [1, 2, 4, 5]].reshape(-1, 2, 2) + np.eye(2)
    predicted = place[None, :, :] + np.einsum("jab,ijb->ija", gradients, offset)
    error = np.linalg.norm(place[:, None, :] - predicted, axis=2)
    fourth = min(_NEAREST_SEEDS, len(points)) - 1
    neighbours = distance <= np.sort(distance, axis=1)[:, [fourth]]
    confirmed = (error < _TOLERANCE_PX + _TOLERANCE * distance) & neighbours & np.isfinite(distance)
    return np.asarray(plausible & confirmed.any(axis=1))


def consistent_field(x_px: Indices, y_px: Indices, warps: Float, converged: Mask) -> Mask:
    """Return which converged points of a grid are predicted by one of their eight neighbours.

    Parameters
    ----------
    x_px, y_px : ndarray of int, shapes (columns,) and (rows,)
    warps : ndarray, shape (rows, columns, 6)
    converged : ndarray of bool, shape (rows, columns)

    Returns
    -------
    ndarray of bool, shape (rows, columns)
        A single plausible point has no neighbour to ask and is kept.
    """
    planes = np.ascontiguousarray(np.moveaxis(warps[..., :6], -1, 0))
    # Points that failed still hold the last step of IC-GN, which may be infinite.
    with np.errstate(invalid="ignore", over="ignore"):
        known = converged & _plausible(planes)
        if known.sum() == 1:
            return known
        consistent = np.zeros(converged.shape, np.bool_)
        right, left = planes[:, :, 1:], planes[:, :, :-1]
        consistent[:, 1:] = known[:, 1:] & known[:, :-1] & _predicts(left, right, np.diff(x_px), 0)
    # Nearly all points are consistent with their left neighbour: only the rest asks the others.
    for down, aside in _NEIGHBOURS:
        rows, columns = np.nonzero(known & ~consistent)
        from_rows, from_columns = rows + down, columns + aside
        inside = (from_rows >= 0) & (from_rows < len(y_px)) & (from_columns >= 0) & (from_columns < len(x_px))
        inside[inside] = known[from_rows[inside], from_columns[inside]]
        here, there = (rows[inside], columns[inside]), (from_rows[inside], from_columns[inside])
        dx, dy = x_px[here[1]] - x_px[there[1]], y_px[here[0]] - y_px[there[0]]
        consistent[here] = _predicts(planes[:, *there], planes[:, *here], dx, dy)
    return consistent


def _predicts(p: Float, other: Float, dx: Indices, dy: Indices | int) -> Mask:
    """Return which warps `p`, shape (6, …), predict the displacements of the `other` points (dx, dy) away."""
    off_x = other[0] - p[0] - p[1] * dx - p[2] * dy
    off_y = other[3] - p[3] - p[4] * dx - p[5] * dy
    limit = _TOLERANCE_PX + _TOLERANCE * np.hypot(dx, dy)
    return np.asarray(off_x * off_x + off_y * off_y < limit * limit)


def _plausible(planes: Float) -> Mask:
    """Return which warps, shape (6, …), have a deformation gradient that a real surface can have."""
    a, b, c, d = 1 + planes[1], planes[2], planes[4], 1 + planes[5]
    # Singular values of a 2 x 2 matrix in closed form; the smaller is negative if the matrix mirrors.
    mean, half = np.sqrt((a + d) ** 2 + (c - b) ** 2) / 2, np.sqrt((a - d) ** 2 + (b + c) ** 2) / 2
    return np.asarray((mean + half < _LARGEST_STRETCH) & (mean - half > _SMALLEST_STRETCH))
