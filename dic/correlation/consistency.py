"""Consistency check: a correlated point is kept only if a neighbour predicts its displacement.

A subset with few speckles can match a wrong place with a good correlation coefficient (ZNCC), but neighbours
do not match wrong places consistently. Real surfaces do not shrink to less than half of their length, do not
stretch to more than twice their length, and are not mirrored. So a warp that describes such a deformation is
also rejected.
"""

import numpy as np

from dic.typing import Float, Indices, Mask

_TOLERANCE_PX, _TOLERANCE = 1.0, 0.1
"""Largest allowed error of a predicted displacement: 1 px plus 0.1 of the distance to the neighbour."""

_LARGEST_STRETCH, _SMALLEST_STRETCH = 2.0, 0.5

_NEAREST_SEEDS = 4

_NEIGHBOURS = ((0, 1), (1, 0), (-1, 0), (1, 1), (-1, -1), (1, -1), (-1, 1))
"""Offsets (row, column) of a point's neighbours, in the order of the checks.

The left neighbour is not in this list, because it is checked before the other neighbours.
"""


def consistent_seeds(points: Indices, warps: Float) -> Mask:
    """Return True for scattered points whose displacement one of the four nearest points predicts.

    `points`, shape (n, 2): coordinates (x, y) of the points, px. `warps`: shape (n, 6).

    Result, shape (n,): True for consistent points. If fewer than three points have a warp that a real surface
    can have, neighbours are not compared, and the result is True for these points.
    """
    plausible = is_plausible(warps.T)
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
    """Return True for converged points whose displacement is predicted by one of their eight neighbours.

    `x_px`, `y_px`: shape (columns,) and (rows,). `warps`: shape (rows, columns, 6). `converged`: shape (rows,
    columns).

    Result, shape (rows, columns): True for consistent points. If only one point has a warp that a real
    surface can have, this point counts as consistent.
    """
    planes = np.ascontiguousarray(np.moveaxis(warps[..., :6], -1, 0))
    # Failed points still hold the warp of the last IC-GN iteration, which may be infinite.
    with np.errstate(invalid="ignore", over="ignore"):
        known = converged & is_plausible(planes)
        if known.sum() == 1:
            return known
        consistent = np.zeros(converged.shape, np.bool_)
        right, left = planes[:, :, 1:], planes[:, :, :-1]
        consistent[:, 1:] = known[:, 1:] & known[:, :-1] & predicts(left, right, np.diff(x_px), 0)
    # Nearly all points are consistent with their left neighbour. Check only the rest with other neighbours.
    for down, aside in _NEIGHBOURS:
        rows, columns = np.nonzero(known & ~consistent)
        from_rows, from_columns = rows + down, columns + aside
        inside = (from_rows >= 0) & (from_rows < len(y_px)) & (from_columns >= 0) & (from_columns < len(x_px))
        inside[inside] = known[from_rows[inside], from_columns[inside]]
        here, there = (rows[inside], columns[inside]), (from_rows[inside], from_columns[inside])
        dx, dy = x_px[here[1]] - x_px[there[1]], y_px[here[0]] - y_px[there[0]]
        consistent[here] = predicts(planes[:, *there], planes[:, *here], dx, dy)
    return consistent


def predicts(p: Float, other: Float, dx: Indices, dy: Indices | int) -> Mask:
    """Return True where the warp `p` predicts the displacement of `other` at the distance (dx, dy)."""
    off_x = other[0] - p[0] - p[1] * dx - p[2] * dy
    off_y = other[3] - p[3] - p[4] * dx - p[5] * dy
    limit = _TOLERANCE_PX + _TOLERANCE * np.hypot(dx, dy)
    return np.asarray(off_x * off_x + off_y * off_y < limit * limit)


def is_plausible(planes: Float) -> Mask:
    """Return True for warps, shape (6, …), with a deformation gradient that a real surface can have."""
    a, b, c, d = 1 + planes[1], planes[2], planes[4], 1 + planes[5]
    # Compute the singular values of a 2 x 2 matrix. The smaller value is negative if the matrix mirrors.
    mean, half = np.sqrt((a + d) ** 2 + (c - b) ** 2) / 2, np.sqrt((a - d) ** 2 + (b + c) ** 2) / 2
    return np.asarray((mean + half < _LARGEST_STRETCH) & (mean - half > _SMALLEST_STRETCH))
