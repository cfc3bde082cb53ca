"""A pinhole camera with lens distortion, and its pose relative to the grid."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import cv2
import numpy as np

from dic.calibration.grid_accuracy import DEVIATIONS
from dic.calibration.pinhole.lens import distort, distortion_basis, distortion_jacobian, folded, undistort
from dic.typing import Float

PARAMETERS = ("focal_px", "x_px", "y_px", "k1", "k2", "p1", "p2", "rx", "ry", "rz", "Cx_mm", "Cy_mm", "Cz_mm")
"""Names of the rows and columns of `Pinhole.covariance`.

The parameters rx, ry and rz describe a small rotation of the camera's axes.
"""


@dataclass(frozen=True)
class Pinhole:
    """A pinhole camera with a distorting lens: each pixel corresponds to a ray through the pinhole.

    In grid axes and in camera axes, X points right, Y up, and Z towards the camera. In the image, x points
    right and y down.

    Attributes
    ----------
    focal_px : float
        Focal length, for square pixels.
    principal_px : ndarray, shape (2,)
        The principal point, where the optical axis meets the sensor.
    distortion : ndarray, shape (4 + m,)
        The distortion coefficients k1 (px⁻²), k2 (px⁻⁴), p1 and p2 (px⁻¹) of `dic.calibration.pinhole.lens`,
        and m further ones where the images ask for them.
    rotation : ndarray, shape (3, 3)
        The rotation matrix from grid axes to camera axes.
    centre_mm : ndarray, shape (3,)
        The position C of the pinhole in grid coordinates; its component Cz is positive.
    covariance : ndarray, shape (13 + m, 13 + m)
        Covariance of the parameters named in `PARAMETERS`, in their units, with rx, ry and rz in radians, and
        of the m further coefficients of `distortion`.
        Parameters that neither the images nor the given values determine have large variances. The
        covariance is 0 for a camera that was not fitted.
    noise_px : float
        Standard deviation of each image coordinate of the grid points, computed from the residuals.
    cross_validation_px : float
        Prediction error: root mean square distance of left-out grid points from their prediction. NaN
        without cross-validation.
    deviations : ndarray, shape (5,)
        The grid's deviations from its nominal shape, as the images show them, in the order of
        `dic.calibration.grid_accuracy.DEVIATIONS`.
    deviation_covariance : ndarray, shape (5, 5)
        Covariance of `deviations`; 0 for a grid without deviations.
    by_deviations : ndarray, shape (13 + m, 5)
        Change of the parameters with the deviations. `covariance` contains this effect.
    """

    focal_px: float
    principal_px: Float
    distortion: Float
    rotation: Float
    centre_mm: Float
    covariance: Float = field(default_factory=lambda: np.zeros((len(PARAMETERS),) * 2))
    noise_px: float = 0.0
    cross_validation_px: float = float("nan")
    deviations: Float = field(default_factory=lambda: np.zeros(len(DEVIATIONS)))
    deviation_covariance: Float = field(default_factory=lambda: np.zeros((len(DEVIATIONS),) * 2))
    by_deviations: Float = field(default_factory=lambda: np.zeros((len(PARAMETERS), len(DEVIATIONS))))

    def __repr__(self) -> str:
        off_axis = f"{self.off_axis_deg:.2f} ± {self.off_axis_std_deg:.2f}° off-axis"
        return f"Pinhole(focal length {self.focal_px:.1f} px, {off_axis}, {self.distance_mm:.2f} mm away)"

    @classmethod
    def swung(
        cls,
        focal_px: float = 2800.0,
        distance_mm: float = 40.0,
        pan_deg: float = 0.0,
        tilt_deg: float = 0.0,
        k1_per_px2: float = 0.0,
        principal_px: tuple[float, float] = (0.0, 0.0),
    ) -> "Pinhole":
        """Return a camera of Helm and Deaner's numerical assessment; it looks at the grid's centre.

        Without pan and tilt the camera is on the grid's normal, at the distance `distance_mm`. Pan turns the
        scene about the vertical axis, then tilt turns it about the horizontal axis: ``R = Rx(tilt)·Ry(pan)``.
        Turning the scene is equivalent to swinging the camera around the grid's centre. The distorted
        coordinate in px is ``x_d = x_u·(1 + k1·r_u²)``, where x_u and r_u are the undistorted coordinate and
        radius.
        """
        pan, tilt = np.radians([pan_deg, tilt_deg])
        about_y = np.array([[np.cos(pan), 0, np.sin(pan)], [0, 1, 0], [-np.sin(pan), 0, np.cos(pan)]])
        about_x = np.array([[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]])
        rotation = about_x @ about_y
        lens = np.array([k1_per_px2, 0.0, 0.0, 0.0])
        return cls(focal_px, np.array(principal_px, float), lens, rotation, rotation[2] * distance_mm)

    @property
    def centre_covariance_mm2(self) -> Float:
        """Covariance of `centre_mm`, shape (3, 3)."""
        return self.covariance[10:13, 10:13]

    @property
    def centre_std_mm(self) -> Float:
        """Standard deviation of `centre_mm`, shape (3,)."""
        return np.sqrt(np.diag(self.centre_covariance_mm2))

    @property
    def focal_std_px(self) -> float:
        """Standard deviation of `focal_px`."""
        return float(np.sqrt(self.covariance[0, 0]))

    @property
    def distance_mm(self) -> float:
        """Distance of the pinhole from the grid's centre."""
        return float(np.linalg.norm(self.centre_mm))

    @property
    def off_axis_deg(self) -> float:
        """Angle between the line of sight through the grid's centre and the grid's normal."""
        return float(np.degrees(np.arctan2(np.hypot(*self.centre_mm[:2]), self.centre_mm[2])))

    @property
    def off_axis_std_deg(self) -> float:
        """Standard deviation of `off_axis_deg` to first order. At 0° off-axis, it is an upper bound."""
        x, y, z = self.centre_mm
        across = float(np.hypot(x, y))
        if across < 1e-12:
            return float(np.degrees(np.sqrt(np.trace(self.centre_covariance_mm2[:2, :2])) / z))
        slope = np.array([x * z / across, y * z / across, -across]) / (across**2 + z**2)
        return float(np.degrees(np.sqrt(slope @ self.centre_covariance_mm2 @ slope)))

    def project(self, points_mm: Float) -> Float:
        """Return the image points of points in space.

        Parameters
        ----------
        points_mm : ndarray, shape (n, 2) or (n, 3)
            Grid coordinates X, Y and Z. If the array has only the two columns X and Y, Z is 0.

        Returns
        -------
        ndarray, shape (n, 2)
            Image coordinates in px. NaN for points behind the camera. The coordinates are also NaN where the
            distortion folds the image over, so that two scene points would have the same image point.
        """
        points = np.asarray(points_mm, np.float64)
        seen = points @ self.rotation[:, : points.shape[1]].T - self.rotation @ self.centre_mm
        depth = np.where(seen[:, 2:] < 0, -seen[:, 2:], np.nan)
        ideal = self.focal_px * seen[:, :2] * np.array([1.0, -1.0]) / depth
        projected = distort(ideal, self.distortion) + self.principal_px
        projected[folded(ideal, self.distortion)] = np.nan
        return projected

    def map(self, px: Float) -> Float:
        """Return the points (n, 2), mm, in which the rays of image points (n, 2), px, meet the grid's plane.

        The result is NaN if an image coordinate is NaN, if the ray misses the grid's plane, or if no ray
        through the distorting lens reaches the image point.
        """
        return self._hit(self._ideal(px))

    def jacobian(self, px: Float) -> Float:
        """Return ``∂(X, Y)/∂(x, y)`` of `map` in mm/px at image points (n, 2), as an array (n, 2, 2)."""
        return self._jacobian(self._ideal(px))

    def map_and_jacobian(self, px: Float) -> tuple[Float, Float]:
        """Return the results of `map` and `jacobian`, which share most of their work."""
        ideal = self._ideal(px)
        return self._hit(ideal), self._jacobian(ideal)

    def _hit(self, ideal: Float) -> Float:
        direction = self._directions(ideal)
        depth = np.where(direction[:, 2:] < 0, direction[:, 2:], np.nan)
        hit: Float = self.centre_mm[:2] - self.centre_mm[2] * direction[:, :2] / depth
        return hit

    def _jacobian(self, ideal: Float) -> Float:
        direction = self._directions(ideal)
        across, depth = direction[:, :2, None], direction[:, 2, None, None]
        # These are the derivatives of the ray's direction (rows X, Y, Z) with respect to x and y of the
        # undistorted point.
        slopes = (self.rotation[:2] * np.array([[1.0], [-1.0]]) / self.focal_px).T
        by_ideal = -self.centre_mm[2] * (slopes[:2] * depth - across * slopes[2:]) / depth**2
        (a, b), (c, d) = np.moveaxis(distortion_jacobian(ideal, self.distortion), 0, -1)
        with np.errstate(invalid="ignore", divide="ignore"):
            determinant = (a * d - b * c)[:, None]
            columns = (
                (by_ideal[:, :, 0] * d[:, None] - by_ideal[:, :, 1] * c[:, None]) / determinant,
                (by_ideal[:, :, 1] * a[:, None] - by_ideal[:, :, 0] * b[:, None]) / determinant,
            )
        jacobian: Float = np.stack(columns, axis=-1)
        jacobian[~np.isfinite(ideal).all(axis=1)] = np.nan
        return jacobian

    def lens_remainder_px(self, px: Float) -> float:
        """Return the rms length of the lens's distortion that k1, k2, k3, p1 and p2 do not describe, px.

        `px`, shape (n, 2): image points.
        """
        ideal = self._ideal(px)
        rest = distort(ideal, self.distortion) - distort(ideal, self.distortion[:5])
        return float(np.sqrt(np.nanmean((rest**2).sum(axis=1))))

    def rays(self, px: Float) -> Float:
        """Return the directions of the rays of image points (n, 2), px, as unit vectors (n, 3) in grid axes.

        The vectors point from the camera into the scene, so rays towards the grid have a negative Z.
        """
        direction = self._directions(self._ideal(px))
        return np.asarray(direction / np.linalg.norm(direction, axis=1, keepdims=True))

    def error_factors(self, px: Float) -> Float:
        """Return a matrix F for each image point (n, 2); F Fᵀ is the error covariance of the mapped point.

        The result has the shape (n, 2, q) and the unit mm. The matrix F follows from the attribute
        `covariance`. Errors of strongly correlated parameters, such as focal length and distance, nearly
        cancel in the mapped points.
        """
        # An error that moves a grid point's image by s moves the mapped point by −J·s, where J is the
        # Jacobian of `map`.
        hit, jacobian = self.map_and_jacobian(px)
        return np.asarray(-jacobian @ (self._slopes_by_parameters(hit) @ self._parameter_factors))

    def centre_factors(self) -> Float:
        """Return a matrix F, shape (3, q), mm; F Fᵀ is the error covariance of `centre_mm`.

        Each column of F belongs to the same source of error as the same column of `error_factors`. So
        `error_factors` and `centre_factors` together also give the correlation between errors of mapped
        points and errors of `centre_mm`.
        """
        return self._parameter_factors[10:13]

    def on_grid(self, deviations: Float, covariance: Float) -> "Pinhole":
        """Return the camera if the grid has these deviations (5,), known with this covariance (5, 5)."""
        change = self.by_deviations @ (deviations - self.deviations)
        # Focal length and distance change together. So the image of the grid's centre and the scale there are
        # changed, as in `dic.calibration.pinhole.model`, and not the camera's centre.
        turn = change[7:10]
        middle = -self.rotation @ self.centre_mm
        moved = np.cross(turn, middle) - self.rotation @ change[10:13]
        longer, scale = change[0] / self.focal_px, -self.focal_px / middle[2]
        larger = longer - moved[2] / middle[2]
        seen = scale * (middle[:2] * (1 + larger) + moved[:2])
        focal_px = self.focal_px * np.exp(longer)
        rotation = cv2.Rodrigues(turn)[0] @ self.rotation
        centre_mm = -rotation.T @ np.append(seen, -focal_px) / (scale * np.exp(larger))
        return replace(
            self,
            focal_px=float(focal_px),
            principal_px=self.principal_px + change[1:3],
            distortion=self.distortion + np.append(change[3:7], change[13:]),
            rotation=rotation,
            centre_mm=centre_mm,
            covariance=self._apart + self.by_deviations @ covariance @ self.by_deviations.T,
            deviations=deviations,
            deviation_covariance=covariance,
        )

    @property
    def _apart(self) -> Float:
        """Covariance of the parameters for a grid with known deviations, of the shape of `covariance`."""
        return self.covariance - self.by_deviations @ self.deviation_covariance @ self.by_deviations.T

    @cached_property
    def _parameter_factors(self) -> Float:
        """Return a matrix F, shape (13 + m, q), for which F Fᵀ is `covariance`.

        If the grid has deviations, the last five columns belong to them.
        """
        if not self.deviation_covariance.any():
            return _factors(self.covariance)
        of_grid = self.by_deviations @ root(self.deviation_covariance)
        return np.column_stack([_factors(self._apart), of_grid])

    def _slopes_by_parameters(self, points_mm: Float) -> Float:
        """Return derivatives (n, 2, 13 + m) of grid points' image coordinates by the parameters."""
        seen = points_mm @ self.rotation[:, :2].T - self.rotation @ self.centre_mm
        ideal = self.focal_px * seen[:, :2] * np.array([-1.0, 1.0]) / seen[:, 2:]
        by_seen = np.zeros((len(seen), 2, 3))
        by_seen[:, 0, 0], by_seen[:, 1, 1] = -self.focal_px / seen[:, 2], self.focal_px / seen[:, 2]
        by_seen[:, :, 2] = -ideal / seen[:, 2:]
        # A small rotation of the camera's axes, with the rotation vector w, moves the camera coordinates s of
        # a point by w × s.
        by_turn = np.stack([by_seen @ _crossed(axis, seen)[:, :, None] for axis in np.eye(3)], axis=-1)[
            :, :, 0
        ]
        bend = distortion_jacobian(ideal, self.distortion)
        by_focal = bend @ (ideal / self.focal_px)[:, :, None]
        by_principal = np.broadcast_to(np.eye(2), (len(seen), 2, 2))
        by_pose = bend @ np.concatenate([by_turn, -by_seen @ self.rotation], axis=2)
        basis = distortion_basis(ideal, len(self.distortion))
        parts = [by_focal, by_principal, basis[:, :, :4], by_pose, basis[:, :, 4:]]
        return np.concatenate(parts, axis=2)

    def _ideal(self, px: Float) -> Float:
        return undistort(np.asarray(px, np.float64).reshape(-1, 2) - self.principal_px, self.distortion)

    def _directions(self, ideal_px: Float) -> Float:
        """Return ray directions (n, 3) in grid axes; their component along the optical axis has length 1."""
        in_camera = np.column_stack([ideal_px * [1.0, -1.0] / self.focal_px, -np.ones(len(ideal_px))])
        directions: Float = in_camera @ self.rotation
        return directions


def _factors(covariance: Float) -> Float:
    """Return a matrix F, shape (n, q), for which F Fᵀ is the covariance; rows of 0 stay 0."""
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    fitted = np.flatnonzero(std)
    correlation = covariance[np.ix_(fitted, fitted)] / np.outer(std[fitted], std[fitted])
    factors = np.zeros((len(std), len(fitted)))
    factors[fitted] = std[fitted, None] * root(correlation)
    return factors


def root(covariance: Float) -> Float:
    """Return a matrix F, shape (n, n), for which F Fᵀ is the covariance."""
    variances, directions = np.linalg.eigh(covariance)
    return np.asarray(directions * np.sqrt(np.maximum(variances, 0.0)))


def _crossed(axis: Float, vectors: Float) -> Float:
    return np.asarray(np.cross(axis, vectors), np.float64)
