"""Which correlated points to believe: those that a neighbour predicts.

A subset of few speckles finds a look-alike somewhere, with a fair ZNCC, but two neighbours do not find theirs
side by side. Nor does a real surface shrink or grow to less than half or more than twice, or turn into its
mirror image.
"""

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]

_TOLERANCE_PX, _TOLERANCE = 1.0, 0.1
"""A prediction may be wrong by so many pixels, and by this share of the distance it was made over."""

_SHAPE = (2.0, 0.5)


def agreeing_seeds(points: NDArray[np.int64], warps: Float) -> NDArray[np.bool_]:
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
    gradients, believed = _believable(warps)
    if believed.sum() < 3:
        return np.asarray(believed)
    offset = (points[:, None, :] - points[None, :, :]).astype(np.float64)
    distance = np.linalg.norm(offset, axis=2)
    distance[:, ~believed] = np.inf
    np.fill_diagonal(distance, np.inf)
    place = points + warps[:, [0, 3]]
    predicted = place[None, :, :] + np.einsum("jab,ijb->ija", gradients, offset)
    error = np.linalg.norm(place[:, None, :] - predicted, axis=2)
    neighbours = distance <= np.sort(distance, axis=1)[:, [min(3, len(points) - 1)]]
    agrees = (error < _TOLERANCE_PX + _TOLERANCE * distance) & neighbours & np.isfinite(distance)
    return np.asarray(believed & agrees.any(axis=1))


def agreeing_field(
    x_px: NDArray[np.int64], y_px: NDArray[np.int64], warps: Float, converged: NDArray[np.bool_]
) -> NDArray[np.bool_]:
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
    _, believable = _believable(warps)
    known = converged & believable
    if known.sum() == 1:
        return known
    u, u_x, u_y, v, v_x, v_y = np.moveaxis(warps[..., :6], -1, 0)
    agrees = np.zeros(converged.shape, np.bool_)
    for rows, columns in ((0, 1), (1, 0), (1, 1), (1, -1)):
        here, there = _shifted(converged.shape, rows, columns)
        both = known[here] & known[there]
        for one, other in ((here, there), (there, here)):
            dx, dy = x_px[one[1]] - x_px[other[1]], (y_px[one[0]] - y_px[other[0]])[:, None]
            # Points that failed hold what IC-GN left there, infinities too.
            with np.errstate(invalid="ignore", over="ignore"):
                off_x = u[one] - u[other] - u_x[other] * dx - u_y[other] * dy
                off_y = v[one] - v[other] - v_x[other] * dx - v_y[other] * dy
            agrees[one] |= both & (np.hypot(off_x, off_y) < _TOLERANCE_PX + _TOLERANCE * np.hypot(dx, dy))
    return agrees


def _believable(warps: Float) -> tuple[Float, NDArray[np.bool_]]:
    """Return deformation gradients (…, 2, 2) and which of them a real surface could have."""
    gradients = warps[..., [1, 2, 4, 5]].reshape(*warps.shape[:-1], 2, 2) + np.eye(2)
    # Singular values of a 2 x 2 matrix in closed form; the smaller is negative if the matrix mirrors.
    (a, b), (c, d) = np.moveaxis(gradients, (-2, -1), (0, 1))
    mean, half = np.hypot(a + d, c - b) / 2, np.hypot(a - d, b + c) / 2
    largest, smallest = _SHAPE
    return gradients, np.asarray((mean + half < largest) & (mean - half > smallest))


def _shifted(
    shape: tuple[int, ...], rows: int, columns: int
) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """Return the two views of a grid that pair every point with its neighbour `rows` and `columns` away."""

    def pair(n: int, shift: int) -> tuple[slice, slice]:
        near, far = slice(0, n - abs(shift)), slice(abs(shift), n)
        return (near, far) if shift >= 0 else (far, near)

    (row_here, row_there), (column_here, column_there) = pair(shape[0], rows), pair(shape[1], columns)
    return (row_here, column_here), (row_there, column_there)
