"""Start values for the fit of a pinhole camera, from the homography of each image (Zhang 2000)."""

from collections.abc import Sequence

import numpy as np

from dic.calibration.pinhole.prior import Prior
from dic.typing import Float

_FOCAL_SHARES = (0.03, 100.0)
"""Limits of the focal length's start value, as multiples of the usual focal length."""


def start_poses(flat: Sequence[Float], focal: float) -> tuple[list[Float], list[list[float]]]:
    """Return the start rotation and the six start parameters of the pose for each homography."""
    poses, rotations = [], []
    for plane in flat:
        # In camera axes, x points right and y up, and the camera looks along −z.
        seen = np.diag([1 / focal, -1 / focal, -1.0]) @ plane
        seen *= -np.sign(seen[2, 2]) * 2 / np.linalg.norm(seen[:, :2], axis=0).sum()
        left, _, right = np.linalg.svd(np.column_stack([seen[:, :2], np.cross(seen[:, 0], seen[:, 1])]))
        rotations.append(left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right)
        scale = focal / -seen[2, 2]
        poses.append([0.0, 0.0, 0.0, scale * seen[0, 2], -scale * seen[1, 2], np.log(scale)])
    return rotations, poses


def start_focals(flat: Sequence[Float], prior: Prior) -> list[float]:
    """Return start values of the focal length, px, in the order in which to try them.

    If the user gives the focal length, this is the only start value. If no focal length is given, the list
    begins with the focal length that follows from the homographies, if they determine one. The list then ends
    with the usual focal length. A homography determines the focal length because the two axes of the grid are
    orthogonal and have the same scale (Zhang).
    """
    if prior.known.focal_px is not None:
        return [prior.known.focal_px]
    factors, sides = [], []
    for plane in flat:
        first, second = (plane[:, :2] / np.linalg.norm(plane[:2, :2])).T
        factors += [first[:2] @ second[:2], first[:2] @ first[:2] - second[:2] @ second[:2]]
        sides += [-first[2] * second[2], second[2] ** 2 - first[2] ** 2]
    squared_inverse = np.dot(factors, sides) / max(np.dot(factors, factors), 1e-300)
    usual = prior.usual_focal_px
    if squared_inverse > (usual * _FOCAL_SHARES[1]) ** -2:
        return [max(float(squared_inverse**-0.5), usual * _FOCAL_SHARES[0]), usual]
    return [usual]


def homographies(xy_mm: Sequence[Float], uv_px: Sequence[Float], principal_px: Float) -> list[Float]:
    """Return the homography (3, 3) of each image, from mm on the grid to px from the principal point."""
    return [_homography(xy, uv - principal_px) for xy, uv in zip(xy_mm, uv_px, strict=True)]


def _homography(xy_mm: Float, uv_px: Float) -> Float:
    """Return the homography (3, 3) from grid to image, by the normalised direct linear transformation."""
    to_unit, from_unit = _unit_square(xy_mm), _unit_square(uv_px)
    xy = np.column_stack([xy_mm, np.ones(len(xy_mm))]) @ to_unit.T
    uv = np.column_stack([uv_px, np.ones(len(uv_px))]) @ from_unit.T
    zero = np.zeros_like(xy)
    rows = np.vstack([np.hstack([xy, zero, -uv[:, :1] * xy]), np.hstack([zero, xy, -uv[:, 1:2] * xy])])
    least = np.linalg.svd(rows, full_matrices=False)[2][-1].reshape(3, 3)
    return np.asarray(np.linalg.inv(from_unit) @ least @ to_unit)


def _unit_square(points: Float) -> Float:
    """Return the matrix (3, 3) that centres points at the origin and scales their coordinates to about 1."""
    middle, size = points.mean(axis=0), float(points.std(axis=0).max())
    return np.array([[1 / size, 0, -middle[0] / size], [0, 1 / size, -middle[1] / size], [0, 0, 1]])
