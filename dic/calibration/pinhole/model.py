"""The pinhole camera as a function of its fitted parameters, with all derivatives.

The parameters are chosen such that they are nearly independent of each other, and that the least-squares
equations can also be solved for a camera that is far away. Seven parameters describe the lens: the logarithm
of the focal length f, the two coordinates of the principal point, and the distortion k1·s², k2·s⁴, p1·s,
p2·s. The length s is the half-width of the grid in the image. Six parameters describe the pose in each image.
Three of the six parameters give a small rotation of the camera's axes from a start rotation. Two give the
undistorted image (a, b) of the grid's centre, relative to the principal point. The sixth parameter is the
logarithm of the scale m in px/mm at the grid's centre. After the poses come k3 and the remainder, if the lens
has them. The last parameters are the deviations of the grid from its nominal shape
(`dic.calibration.grid_accuracy`), which all images share. The rotation R gives the
position q = R·X of a grid point X, relative to the grid's centre, in camera axes. The undistorted image of
the grid point is

    x = (m·q_x + a) / (1 − m·q_z/f),    y = (b − m·q_y) / (1 − m·q_z/f)

In these formulas the focal length f appears only in the denominators, which describe perspective.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dic.calibration.grid_accuracy import DEVIATIONS, deviated
from dic.calibration.pinhole.lens import distort, distortion_basis, distortion_jacobian, powers
from dic.typing import Float, Indices

LENS = 7
POSE = 6
GRID = len(DEVIATIONS)


@dataclass(frozen=True)
class CameraModel:
    """The pinhole model of one camera in several images; its attributes are constant during a fit."""

    xy_mm: Sequence[Float]
    """Each of shape (n, 2). Coordinates X and Y of the grid points of each image."""
    starts: Sequence[Float]
    """Each of shape (3, 3). Start rotation of each image, from grid to camera axes."""
    scale_px: float
    """Half-width of the grid in the image, by which the distortion coefficients are scaled."""
    half_mm: Float
    """Shape (2,). Half widths of the grid along X and Y."""

    def project(self, parameters: Float) -> tuple[Float, Float]:
        """Return the image coordinates of n grid points, px, shape (2·n,), and their derivatives.

        The derivatives with respect to the fitted parameters have the shape (2·n, parameters).
        """
        seen, slopes = [], []
        for view, (xy, start) in enumerate(zip(self.xy_mm, self.starts, strict=True)):
            own = slice(LENS + POSE * view, LENS + POSE * (view + 1))
            places, by_deviation = deviated(xy, self.half_mm, parameters[-GRID:])
            px, by_lens, by_pose, by_place = self._view(parameters, parameters[own], places, start)
            rows = np.zeros((px.size, len(parameters)))
            rows[:, -GRID:] = (by_place @ by_deviation).reshape(-1, GRID)
            rows[:, self.lens(len(parameters))] = by_lens.reshape(px.size, -1)
            rows[:, own] = by_pose.reshape(-1, POSE)
            seen.append(px.ravel())
            slopes.append(rows)
        return np.concatenate(seen), np.vstack(slopes)

    def lens(self, count: int) -> Indices:
        """Return the indices of the parameters of the lens among `count` parameters."""
        more = np.arange(self.poses_end, count - GRID)
        return np.append(np.arange(LENS), more)

    @property
    def poses_end(self) -> int:
        """Index of the first parameter after the poses: of k3, if the lens has more than four terms."""
        return LENS + POSE * len(self.starts)

    def distortion(self, parameters: Float) -> Float:
        """Return the coefficients of `dic.calibration.pinhole.lens`, shape (4,) or more."""
        scaled = parameters[self.lens(len(parameters))[3:]]
        coefficients: Float = scaled / self.scale_px ** powers(len(scaled))
        return coefficients

    def _view(
        self, parameters: Float, pose: Float, xyz_mm: Float, start: Float
    ) -> tuple[Float, Float, Float, Float]:
        focal, scale = np.exp(parameters[0]), np.exp(pose[5])
        turn, turn_slope = small_turn(pose[:3])
        q = xyz_mm @ (turn @ start).T
        nearer = (scale / focal * q[:, 2])[:, None]
        flat = scale * q[:, :2] * [1.0, -1.0]
        ideal = (flat + pose[3:5] * np.ones(2)) / (1 - nearer)

        by_q = np.zeros((len(q), 2, 3))
        by_q[:, 0, 0], by_q[:, 1, 1] = scale, -scale
        by_q[:, :, 2] = ideal * scale / focal
        # A small rotation with the rotation vector w moves the point q by w × q.
        by_turn = -by_q @ _cross(q) @ turn_slope
        by_place = np.broadcast_to(np.eye(2), (len(q), 2, 2))
        by_scale = flat + ideal * nearer
        ideal_by_point = by_q @ (turn @ start) / (1 - nearer)[:, :, None]
        ideal_by_pose = np.concatenate([by_turn, by_place, by_scale[:, :, None]], axis=2)
        ideal_by_pose /= (1 - nearer)[:, :, None]
        ideal_by_focal = -ideal * nearer / (1 - nearer)

        coefficients = self.distortion(parameters)
        count = len(coefficients)
        bend = distortion_jacobian(ideal, coefficients)
        basis = distortion_basis(ideal, count) / self.scale_px ** powers(count)
        by_lens = np.concatenate([bend @ ideal_by_focal[:, :, None], by_place, basis], axis=2)
        return (
            distort(ideal, coefficients) + parameters[1:3],
            by_lens,
            bend @ ideal_by_pose,
            bend @ ideal_by_point,
        )

    def camera(self, parameters: Float, view: int) -> tuple[Float, Float, Float, Float]:
        """Return the parameters of the camera, and its pose in image number `view`.

        Returns
        -------
        rotation : ndarray, shape (3, 3)
            The rotation matrix from grid axes to camera axes.
        centre : ndarray, shape (3,)
            The position of the pinhole in grid axes, mm.
        values : ndarray, shape (13 + m,)
            Values in the order of `dic.calibration.pinhole.camera.PARAMETERS`, then the m further
            coefficients of the lens. The small rotation is 0.
        derivatives : ndarray, shape (13 + m, parameters)
            Derivatives of `values` with respect to the parameters of this model.
        """
        own = LENS + POSE * view
        pose = parameters[own : own + POSE]
        focal, scale = np.exp(parameters[0]), np.exp(pose[5])
        turn, turn_slope = small_turn(pose[:3])
        rotation = turn @ self.starts[view]
        origin = np.array([pose[3], -pose[4], -focal]) / scale
        centre = -rotation.T @ origin

        distortion = self.distortion(parameters)
        to_px = 1 / self.scale_px ** powers(len(distortion))
        more = np.arange(len(distortion) - 4)
        slopes = np.zeros((13 + len(more), len(parameters)))
        slopes[0, 0] = focal
        slopes[1, 1] = slopes[2, 2] = 1.0
        slopes[range(3, 7), range(3, 7)] = to_px[:4]
        slopes[13 + more, self.poses_end + more] = to_px[4:]
        slopes[7:10, own : own + 3] = turn_slope
        # The pinhole is C = −Rᵀ·t, with the grid's centre t in camera axes. A small rotation w of R moves C
        # by Rᵀ·(w × t).
        slopes[10:13, own : own + 3] = -rotation.T @ _cross(origin[None])[0] @ turn_slope
        slopes[10:13, own + 3 : own + 5] = -rotation.T[:, :2] * [1 / scale, -1 / scale]
        slopes[10:13, own + 5] = -centre
        slopes[10:13, 0] = rotation.T[:, 2] * focal / scale
        first, rest = distortion[:4], distortion[4:]
        values = np.concatenate([[focal], parameters[1:3], first, np.zeros(3), centre, rest])
        return rotation, centre, values, slopes


def small_turn(vector: Float) -> tuple[Float, Float]:
    """Return the rotation matrix of a rotation vector v, and its left Jacobian J, both (3, 3).

    The rotation matrix follows from Rodrigues' formula. A small change dv of the rotation vector v adds the
    rotation J·dv.
    """
    angle = float(np.linalg.norm(vector))
    cross = _cross(vector[None])[0]
    if angle < 1e-4:
        first, second, third = 1 - angle**2 / 6, 0.5 - angle**2 / 24, 1 / 6 - angle**2 / 120
    else:
        first, second = np.sin(angle) / angle, (1 - np.cos(angle)) / angle**2
        third = (angle - np.sin(angle)) / angle**3
    square = cross @ cross
    return np.eye(3) + first * cross + second * square, np.eye(3) + second * cross + third * square


def _cross(vectors: Float) -> Float:
    """Return the matrices, shape (n, 3, 3), whose product with a vector w is v × w, for vectors v (n, 3)."""
    matrices = np.zeros((len(vectors), 3, 3))
    for i, (j, k) in enumerate(((1, 2), (2, 0), (0, 1))):
        matrices[:, k, j], matrices[:, j, k] = vectors[:, i], -vectors[:, i]
    return matrices
