"""Chain displacement fields: from a first reference over later ones to an image."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dic.correlation.field import Field
from dic.correlation.status import Status
from dic.typing import Float, Indices, Mask

_CELL_REACH = 0.7
"""Steps around a point that move with it: half a step, and a little more for sheared grids."""

_EXTRAPOLATION_REACH = 1.5
"""Steps over which the nearest point's motion is extrapolated if one of the four around is missing."""


def chain(first: Field, second: Field) -> Field:
    """Return the displacements of the first field's points after both motions.

    Parameters
    ----------
    first : Field
        From the first reference to a later one.
    second : Field
        From that later reference onwards, on a grid of its own.

    Returns
    -------
    Field
        On the grid of `first`, with affine warps. Gradients are those of F₂F₁; standard deviations are the
        roots of summed variances. A point that failed in either field has failed.
    """
    rows, columns = np.nonzero(first.converged)
    x, y = first.x_px[columns] + first.u_px[rows, columns], first.y_px[rows] + first.v_px[rows, columns]
    place = np.stack([x, y], axis=1)
    moved = _interpolated(second, place)
    warps = np.full((*first.status.shape, 6), np.nan)
    std = np.full_like(warps, np.nan)
    status, zncc, iterations = first.status.copy(), first.zncc.copy(), first.iterations.copy()
    before = first.warps[rows, columns, :6]
    known = np.isfinite(moved.warps).all(axis=1)
    warps[rows[known], columns[known]] = _composed(before[known], moved.warps[known])
    std[rows, columns] = np.hypot(first.std[rows, columns], moved.std)
    std[rows[~known], columns[~known]] = np.nan
    status[rows, columns] = np.where(known, Status.CONVERGED, moved.status)
    zncc[rows, columns], iterations[rows, columns] = moved.zncc, moved.iterations
    return Field(
        first.x_px, first.y_px, warps, std, zncc, iterations, status, first.active, second.start,
        first.settings, first.updates + 1 + second.updates,
    )  # fmt: skip


class _Interpolated(NamedTuple):
    """A field's values at places between its points; warps are NaN where there are none."""

    warps: Float
    std: Float
    status: NDArray[np.int8]
    zncc: Float
    iterations: NDArray[np.int16]


def _interpolated(field: Field, place: Float) -> _Interpolated:
    """Return the field's values at `place` (n, 2), between its points.

    Four points around the place, at distances d, have values f and slopes ∇f. The bilinear mean of f + ∇f·d/2
    is exact for every quadratic function: the errors of interpolation and of extrapolation cancel.
    """
    step = _step(field)
    at = (place - [field.x_px[0], field.y_px[0]]) / step
    shape = np.array(field.status.shape[::-1])
    cell = np.clip(np.floor(at), 0, np.maximum(shape - 2, 0)).astype(np.int64)
    fraction = at - cell
    warps, std = np.zeros((len(place), 6)), np.zeros((len(place), 6))
    complete = ((fraction >= 0) & (fraction <= 1)).all(axis=1) & (shape > 1).all()
    for i, j in ((0, 0), (0, 1), (1, 0), (1, 1)):
        row, column = np.minimum(cell[:, 1] + i, shape[1] - 1), np.minimum(cell[:, 0] + j, shape[0] - 1)
        weight = np.abs(1 - i - fraction[:, 1]) * np.abs(1 - j - fraction[:, 0])
        complete &= field.converged[row, column]
        corner = _extrapolated(field, row, column, place, 0.5)
        warps += weight[:, None] * np.where(np.isfinite(corner), corner, 0.0)
        variance = np.square(field.std[row, column])
        # A point whose texture is all noise has an infinite variance, which 0 would turn into NaN.
        std += np.multiply(weight[:, None], variance, out=np.zeros_like(variance), where=weight[:, None] > 0)
    std = np.sqrt(std)
    row, column = _nearest_converged(field, at)
    near = np.hypot(*(at - np.stack([column, row], axis=1)).T) <= _EXTRAPOLATION_REACH
    alone = ~complete & near
    warps[alone] = _extrapolated(field, row[alone], column[alone], place[alone], 1.0)
    std[alone] = field.std[row[alone], column[alone]]
    warps[~complete & ~near] = np.nan
    own = np.clip(np.rint(at), 0, shape - 1).astype(np.int64)
    failed = field.status[own[:, 1], own[:, 0]]
    status = np.where(failed == Status.CONVERGED, np.int8(Status.NOT_REACHED), failed)
    return _Interpolated(warps, std, status, field.zncc[row, column], field.iterations[row, column])


def _extrapolated(field: Field, row: Indices, column: Indices, place: Float, share: float) -> Float:
    """Return warps (n, 6) at `place` (n, 2), from points at row, column and a `share` of their slopes."""
    warps: Float = field.warps[row, column, :6].copy()
    dx, dy = place[:, 0] - field.x_px[column], place[:, 1] - field.y_px[row]
    warps[:, 0] += share * (warps[:, 1] * dx + warps[:, 2] * dy)
    warps[:, 3] += share * (warps[:, 4] * dx + warps[:, 5] * dy)
    return warps


def _nearest_converged(field: Field, at: Float) -> tuple[Indices, Indices]:
    """Return row and column of the converged points nearest to `at` (n, 2), given in steps of the grid."""
    from scipy.spatial import cKDTree

    rows, columns = np.nonzero(field.converged)
    _, nearest = cKDTree(np.stack([columns, rows], axis=1)).query(at)
    return rows[nearest], columns[nearest]


def _composed(first: Float, second: Float) -> Float:
    """Return the warps (n, 6) of `second` after `first`."""
    one, other = (w[:, [1, 2, 4, 5]].reshape(-1, 2, 2) + np.eye(2) for w in (first, second))
    gradient = (other @ one - np.eye(2)).reshape(-1, 4)
    u, v = first[:, 0] + second[:, 0], first[:, 3] + second[:, 3]
    return np.column_stack([u, gradient[:, :2], v, gradient[:, 2:]])


def moved_region(region: Mask, field: Field) -> Mask:
    """Return where a region of the reference is in the deformed image, as far as points converged.

    A pixel of the deformed image moves with the point that is nearest to it there. It belongs to the region
    if the motion of that point takes it back to a pixel of the region near the point. Pixels between the
    lips of an open crack are taken back too far from their point.

    Parameters
    ----------
    region : ndarray of bool, shape (height, width)
    field : Field

    Returns
    -------
    ndarray of bool, shape (height, width)
    """
    import cv2

    height, width = region.shape
    rows, columns = np.nonzero(field.converged)
    x = np.rint(field.x_px[columns] + field.u_px[rows, columns]).astype(np.int64)
    y = np.rint(field.y_px[rows] + field.v_px[rows, columns]).astype(np.int64)
    inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
    x, y, rows, columns = x[inside], y[inside], rows[inside], columns[inside]
    elsewhere = np.ones(region.shape, np.uint8)
    elsewhere[y, x] = 0
    _, labels = cv2.distanceTransformWithLabels(elsewhere, cv2.DIST_L2, 3, labelType=cv2.DIST_LABEL_PIXEL)
    point_of_label = np.zeros(int(labels.max()) + 1, np.int64)
    point_of_label[labels[y, x]] = np.arange(len(x))
    gradient = field.gradient[rows, columns].reshape(-1, 2, 2) + np.eye(2)
    back = np.linalg.inv(gradient)
    moved = np.zeros(region.shape, np.bool_)
    reach = _CELL_REACH * _step(field) + 1
    for line in range(height):
        point = point_of_label[labels[line]]
        row, column = rows[point], columns[point]
        dx = np.arange(width) - field.x_px[column] - field.u_px[row, column]
        dy = line - field.y_px[row] - field.v_px[row, column]
        from_x = back[point, 0, 0] * dx + back[point, 0, 1] * dy
        from_y = back[point, 1, 0] * dx + back[point, 1, 1] * dy
        near = (np.abs(from_x) <= reach) & (np.abs(from_y) <= reach)
        at_x = np.clip(np.rint(field.x_px[column] + from_x), 0, width - 1).astype(np.int64)
        at_y = np.clip(np.rint(field.y_px[row] + from_y), 0, height - 1).astype(np.int64)
        moved[line] = near & region[at_y, at_x]
    return moved


def _step(field: Field) -> int:
    """Return the distance of the field's points, px; 1 if there is a single one."""
    for along in (field.x_px, field.y_px):
        if len(along) > 1:
            return int(along[1] - along[0])
    return 1
