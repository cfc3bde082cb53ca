"""Which correlated points to believe: those that a neighbour predicts.

A subset of few speckles finds a look-alike somewhere, with a fair ZNCC, but two neighbours do not find theirs
side by side. Nor does a real surface shrink or grow to less than half or more than twice, or turn into its
mirror image.
"""

import numpy as np

from dic.typing import Float, Indices, Mask

_TOLERANCE_PX, _TOLERANCE = 1.0, 0.1
"""A prediction may be wrong by so many pixels, and by this share of the distance it was made over."""

_SHAPE = (2.0, 0.5)

_AROUND = ((0, 1), (1, 0), (-1, 0), (1, 1), (-1, -1), (1, -1), (-1, 1))
"""Rows and columns to the neighbours on a grid, in the order in which they are asked."""


def consistent_seeds(points: Indices, warps: Float) -> Mask:
    """Tell which scattered points one of their four nearest neighbours predicts.

    Parameters
    ----------
    points : ndarray of int, shape (n, 2)
    warps : ndarray, shape (n, 6)

    Returns
    -------
    ndarray of bool, shape (n,)
        All true for fewer than three seeds of believable shape, which cannot be told from one another.
    """
    believed = _believable(warps.T)
    if believed.sum() < 3:
        return np.asarray(believed)
    offset = (points[:, None, :] - points[None, :, :]).astype(np.float64)
    distance = np.linalg.norm(offset, axis=2)
    distance[:, ~believed] = np.inf
    np.fill_diagonal(distance, np.inf)
    place = points + warps[:, [0, 3]]
    gradients = warps[:, [1, 2, 4, 5]].reshape(-1, 2, 2) + np.eye(2)
    predicted = place[None, :, :] + np.einsum("jab,ijb->ija", gradients, offset)
    error = np.linalg.norm(place[:, None, :] - predicted, axis=2)
    neighbours = distance <= np.sort(distance, axis=1)[:, [min(3, len(points) - 1)]]
    agrees = (error < _TOLERANCE_PX + _TOLERANCE * distance) & neighbours & np.isfinite(distance)
    return np.asarray(believed & agrees.any(axis=1))


def consistent_field(x_px: Indices, y_px: Indices, warps: Float, converged: Mask) -> Mask:
    """Tell which converged points of a grid one of their eight neighbours predicts.

    Parameters
    ----------
    x_px, y_px : ndarray of int, shapes (columns,) and (rows,)
    warps : ndarray, shape (rows, columns, 6)
    converged : ndarray of bool, shape (rows, columns)

    Returns
    -------
    ndarray of bool, shape (rows, columns)
        A grid of a single converged point, which nothing can contradict, keeps it.
    """
    planes = np.ascontiguousarray(np.moveaxis(warps[..., :6], -1, 0))
    # Points that failed hold what IC-GN left there, infinities too.
    with np.errstate(invalid="ignore", over="ignore"):
        known = converged & _believable(planes)
        if known.sum() == 1:
            return known
        agrees = np.zeros(converged.shape, np.bool_)
        right, left = planes[:, :, 1:], planes[:, :, :-1]
        agrees[:, 1:] = known[:, 1:] & known[:, :-1] & _predicts(left, right, np.diff(x_px), 0)
    # Nearly all points agree with the first neighbour: the others are asked only about the rest.
    for down, aside in _AROUND:
        rows, columns = np.nonzero(known & ~agrees)
        from_rows, from_columns = rows + down, columns + aside
        inside = (from_rows >= 0) & (from_rows < len(y_px)) & (from_columns >= 0) & (from_columns < len(x_px))
        inside[inside] = known[from_rows[inside], from_columns[inside]]
        here, there = (rows[inside], columns[inside]), (from_rows[inside], from_columns[inside])
        dx, dy = x_px[here[1]] - x_px[there[1]], y_px[here[0]] - y_px[there[0]]
        agrees[here] = _predicts(planes[:, *there], planes[:, *here], dx, dy)
    return agrees


def _predicts(p: Float, other: Float, dx: Indices, dy: Indices | int) -> Mask:
    """Tell whether warps `p`, shape (6, …), predict the displacements of the `other` points (dx, dy) away."""
    off_x = other[0] - p[0] - p[1] * dx - p[2] * dy
    off_y = other[3] - p[3] - p[4] * dx - p[5] * dy
    limit = _TOLERANCE_PX + _TOLERANCE * np.hypot(dx, dy)
    return np.asarray(off_x * off_x + off_y * off_y < limit * limit)


def _believable(planes: Float) -> Mask:
    """Tell which warps, shape (6, …), have deformation gradients that a real surface could have."""
    a, b, c, d = 1 + planes[1], planes[2], planes[4], 1 + planes[5]
    # Singular values of a 2 x 2 matrix in closed form; the smaller is negative if the matrix mirrors.
    mean, half = np.sqrt((a + d) ** 2 + (c - b) ** 2) / 2, np.sqrt((a - d) ** 2 + (b + c) ** 2) / 2
    largest, smallest = _SHAPE
    return np.asarray((mean + half < largest) & (mean - half > smallest))
