"""Chain displacement fields: add the motion up to a later reference and the motion from there to an image."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dic.correlation.field import Field
from dic.correlation.status import Status
from dic.image.given import fixed
from dic.typing import Float, Indices, Mask

_CELL_REACH = 0.7
"""Pixels within this distance of a point, in units of the grid's spacing, are taken to move with the point.

Half a step would be enough for a square grid, but a sheared grid needs a little more.
"""

_EXTRAPOLATION_REACH = 1.5
"""Largest distance, in steps of the grid, over which the motion of a single point is extrapolated.

A displacement is extrapolated, and not interpolated, where one of the four surrounding points failed.
"""


def chain(first: Field, second: Field) -> Field:
    """Return the displacements from the first reference to an image, by way of a later reference.

    `first`: the field from the first reference to a later reference. `second`: the field from the later
    reference to an image, on a grid of its own.

    Result: a field on the grid of `first`, with affine warps. The gradients are those of F₂F₁, the product of
    both deformation gradients. The variances of both fields are added, and so are their biases. A point that
    failed in either field also fails in the result.
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
    bias = np.zeros((*first.status.shape, 2))
    # Both biases come from the same pattern, so the biases themselves are added and not their squares.
    bias[rows, columns] = first.bias_px[rows, columns] + moved.bias_px
    status[rows, columns] = np.where(known, Status.CONVERGED, moved.status)
    zncc[rows, columns], iterations[rows, columns] = moved.zncc, moved.iterations
    return Field(
        first.x_px, first.y_px, warps, std, zncc, iterations, status, first.active, second.start,
        first.settings, first.updates + 1 + second.updates, first.region, first.grid,
        first.smoothing_px, first.greatest_bias_px, bias, second.repetition or first.repetition,
    )  # fmt: skip


class _Interpolated(NamedTuple):
    """Values of a displacement field between its points; warps are NaN where the field has no value."""

    warps: Float
    std: Float
    status: NDArray[np.int8]
    zncc: Float
    iterations: NDArray[np.int16]
    bias_px: Float


def _interpolated(field: Field, place: Float) -> _Interpolated:
    """Return the field's values at places (n, 2) between its points.

    Each place lies between four points of the field. Each of these points has the value f, the gradient ∇f
    and the distance vector d to the place. The result is the bilinear mean of the four values f + ∇f·d/2. The
    mean is exact for every quadratic function f. For a quadratic function, the error of bilinear
    interpolation and the error of linear extrapolation cancel.
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
        # A point with only noise has an infinite variance, and 0 times infinity would be NaN.
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
    nearest = row, column
    return _Interpolated(
        warps, std, status, field.zncc[nearest], field.iterations[nearest], field.bias_px[nearest]
    )


def _extrapolated(field: Field, row: Indices, column: Indices, place: Float, share: float) -> Float:
    """Return warps (n, 6) at places (n, 2), each extrapolated from one point with `share` of its gradient."""
    warps: Float = field.warps[row, column, :6].copy()
    dx, dy = place[:, 0] - field.x_px[column], place[:, 1] - field.y_px[row]
    warps[:, 0] += share * (warps[:, 1] * dx + warps[:, 2] * dy)
    warps[:, 3] += share * (warps[:, 4] * dx + warps[:, 5] * dy)
    return warps


def _nearest_converged(field: Field, at: Float) -> tuple[Indices, Indices]:
    """Return row and column of the converged points nearest to places `at` (n, 2), in steps of the grid."""
    from scipy.spatial import cKDTree

    rows, columns = np.nonzero(field.converged)
    _, nearest = cKDTree(np.stack([columns, rows], axis=1)).query(at)
    return rows[nearest], columns[nearest]


def _composed(first: Float, second: Float) -> Float:
    """Return the affine warps (n, 6) that apply the warps `first` and then the warps `second`."""
    one, other = (w[:, [1, 2, 4, 5]].reshape(-1, 2, 2) + np.eye(2) for w in (first, second))
    gradient = (other @ one - np.eye(2)).reshape(-1, 4)
    u, v = first[:, 0] + second[:, 0], first[:, 3] + second[:, 3]
    return np.column_stack([u, gradient[:, :2], v, gradient[:, 2:]])


def moved_region(region: Mask, field: Field) -> Mask:
    """Return where the pixels of a region of the reference lie in the deformed image, as a mask.

    For each pixel of the deformed image, the inverse motion of the nearest converged point gives a place in
    the reference. The pixel belongs to the moved region if this place is in the reference's region and close
    to the converged point. For a pixel inside an open crack the place is far from the point, so the pixel is
    excluded.

    `region`, shape (height, width): the region in the reference. `field`: the field from the reference to the
    deformed image.

    Result: the region in the deformed image; the mask is read-only.
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
    return fixed(moved)


def _step(field: Field) -> int:
    """Return the spacing of the field's points in px, or 1 if the field has a single point."""
    for along in (field.x_px, field.y_px):
        if len(along) > 1:
            return int(along[1] - along[0])
    return 1
