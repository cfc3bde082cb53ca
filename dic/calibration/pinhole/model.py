"""The pinhole camera as a function of its fitted parameters, with all derivatives.

The parameters are chosen to be nearly independent of each other, and to stay regular for a camera that is far
away. Seven parameters describe the lens: the logarithm of the focal length f, the principal point, and k1·s²,
k2·s⁴, p1·s, p2·s, where s is the half-width of the grid in the image. Six parameters describe the pose in
each image: a small rotation of the camera's axes from a start rotation, the grid's centre (a, b) in the
undistorted image relative to the principal point, and the logarithm of the scale m there, px/mm. With q = R·X
in camera axes, the undistorted image of a grid point is

    x = (m·q_x + a) / (1 − m·q_z/f),    y = (b − m·q_y) / (1 − m·q_z/f)

So f affects only the perspective.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dic.calibration.pinhole.lens import distort, distortion_basis, distortion_jacobian
from dic.typing import Float

LENS = 7
POSE = 6
_POWERS = np.array([2, 4, 1, 1])


@dataclass(frozen=True)
class CameraModel:
    """The constants of the model: grid points, start rotations and the scale of distortion.

    Attributes
    ----------
    xy_mm : sequence of ndarray, shape (n, 2)
        Grid points of each image.
    starts : sequence of ndarray, shape (3, 3)
        Start rotation of each image, from grid to camera axes.
    scale_px : float
        Half-width s of the grid in the image.
    """

    xy_mm: Sequence[Float]
    starts: Sequence[Float]
    scale_px: float

    def project(self, parameters: Float) -> tuple[Float, Float]:
        """Return the image coordinates (2·n,), px, of n points, and their derivatives (2·n, parameters)."""
        seen, slopes = [], []
        for view, (xy, start) in enumerate(zip(self.xy_mm, self.starts, strict=True)):
            own = slice(LENS + POSE * view, LENS + POSE * (view + 1))
            px, by_lens, by_pose = self._view(parameters[:LENS], parameters[own], xy, start)
            rows = np.zeros((px.size, len(parameters)))
            rows[:, :LENS] = by_lens.reshape(-1, LENS)
            rows[:, own] = by_pose.reshape(-1, POSE)
            seen.append(px.ravel())
            slopes.append(rows)
        return np.concatenate(seen), np.vstack(slopes)

    def distortion(self, parameters: Float) -> Float:
        """Return k1, k2, p1 and p2, shape (4,), in px⁻², px⁻⁴, px⁻¹ and px⁻¹."""
        coefficients: Float = parameters[3:LENS] / self.scale_px**_POWERS
        return coefficients

    def _view(self, lens: Float, pose: Float, xy_mm: Float, start: Float) -> tuple[Float, Float, Float]:
        focal, scale = np.exp(lens[0]), np.exp(pose[5])
        turn, turn_slope = small_turn(pose[:3])
        q = xy_mm @ (turn @ start)[:, :2].T
        nearer = (scale / focal * q[:, 2])[:, None]
        flat = scale * q[:, :2] * [1.0, -1.0]
        ideal = (flat + pose[3:5] * np.ones(2)) / (1 - nearer)

        by_q = np.zeros((len(q), 2, 3))
        by_q[:, 0, 0], by_q[:, 1, 1] = scale, -scale
        by_q[:, :, 2] = ideal * scale / focal
        # a small rotation w moves q by w × q
        by_turn = -by_q @ _cross(q) @ turn_slope
        by_place = np.broadcast_to(np.eye(2), (len(q), 2, 2))
        by_scale = flat + ideal * nearer
        ideal_by_pose = np.concatenate([by_turn, by_place, by_scale[:, :, None]], axis=2)
        ideal_by_pose /= (1 - nearer)[:, :, None]
        ideal_by_focal = -ideal * nearer / (1 - nearer)

        coefficients = self.distortion(lens)
        bend = distortion_jacobian(ideal, coefficients)
        basis = distortion_basis(ideal) / self.scale_px**_POWERS
        by_lens = np.concatenate([bend @ ideal_by_focal[:, :, None], by_place, basis], axis=2)
        return distort(ideal, coefficients) + lens[1:3], by_lens, bend @ ideal_by_pose

    def camera(self, parameters: Float, view: int) -> tuple[Float, Float, Float, Float]:
        """Return the camera of the image number `view`.

        Returns
        -------
        rotation : ndarray, shape (3, 3)
            From grid to camera axes.
        centre : ndarray, shape (3,)
            The pinhole in grid axes, mm.
        values : ndarray, shape (13,)
            In the order of `dic.calibration.pinhole.camera.PARAMETERS`; the small rotation is 0.
        derivatives : ndarray, shape (13, parameters)
            Derivatives of the values by the parameters of this model.
        """
        own = LENS + POSE * view
        pose = parameters[own : own + POSE]
        focal, scale = np.exp(parameters[0]), np.exp(pose[5])
        turn, turn_slope = small_turn(pose[:3])
        rotation = turn @ self.starts[view]
        origin = np.array([pose[3], -pose[4], -focal]) / scale
        centre = -rotation.T @ origin

        slopes = np.zeros((13, len(parameters)))
        slopes[0, 0] = focal
        slopes[1, 1] = slopes[2, 2] = 1.0
        slopes[range(3, 7), range(3, 7)] = 1 / self.scale_px**_POWERS
        slopes[7:10, own : own + 3] = turn_slope
        # C = −Rᵀ·t: a small rotation w of R moves C by Rᵀ·(w × t)
        slopes[10:, own : own + 3] = -rotation.T @ _cross(origin[None])[0] @ turn_slope
        slopes[10:, own + 3 : own + 5] = -rotation.T[:, :2] * [1 / scale, -1 / scale]
        slopes[10:, own + 5] = -centre
        slopes[10:, 0] = rotation.T[:, 2] * focal / scale
        values = np.concatenate([[focal], parameters[1:3], self.distortion(parameters), np.zeros(3), centre])
        return rotation, centre, values, slopes


def small_turn(vector: Float) -> tuple[Float, Float]:
    """Return the rotation exp([v]×) and its left Jacobian J, both (3, 3).

    A change dv of v adds the rotation J·dv. The first is Rodrigues' formula.
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
    """Return the matrices [v]×, shape (n, 3, 3), of vectors v (n, 3): [v]×·w is v × w."""
    matrices = np.zeros((len(vectors), 3, 3))
    for i, (j, k) in enumerate(((1, 2), (2, 0), (0, 1))):
        matrices[:, k, j], matrices[:, j, k] = vectors[:, i], -vectors[:, i]
    return matrices
