"""The plane of a specimen's surface, and the positions of calibrated points on this plane.

A calibration maps a pixel to the point m where its ray meets the grid's plane z = 0. The ray runs from the
camera's centre C through (m, 0). The surface z = w + a x + b y of a specimen meets the same ray at another
point, C + t ((m, 0) - C), with

    t = (Cz - w - a Cx - b Cy) / (Cz + a (mx - Cx) + b (my - Cy)).
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from dic.strain.displacement import Displacement
from dic.typing import Float

_STEP = 1e-5
"""Step in slopes by which numerical derivatives of axes are computed."""


@dataclass(frozen=True)
class Plane:
    """The plane z = shift + slope_x · X + slope_y · Y in the grid's axes.

    Attributes
    ----------
    slope_x, slope_y : float
        Slopes of the plane along X and Y (tangents of angles). A positive slope rises towards the camera.
    shift_mm : float
        Height of the plane at the grid's centre.
    """

    slope_x: float = 0.0
    slope_y: float = 0.0
    shift_mm: float = 0.0

    @classmethod
    def across(cls, normal: Float, point_mm: Float) -> "Plane":
        """Return the plane through the point `point_mm` (3,) that is perpendicular to `normal` (3,)."""
        slope_x, slope_y = -normal[0] / normal[2], -normal[1] / normal[2]
        return cls(slope_x, slope_y, float(point_mm[2] - slope_x * point_mm[0] - slope_y * point_mm[1]))

    @cached_property
    def normal(self) -> Float:
        """Normal of the plane towards the camera, a unit vector (3,)."""
        normal = np.array([-self.slope_x, -self.slope_y, 1.0])
        return np.asarray(normal / np.linalg.norm(normal))

    @cached_property
    def axes(self) -> Float:
        """Axes within the plane, unit vectors (2, 3): X and Y after the smallest rotation into the plane."""
        normal = self.normal
        across = np.array([-normal[1], normal[0], 0.0])
        sine = np.hypot(normal[0], normal[1])
        if sine == 0.0:
            return np.eye(3)[:2]
        k = across / sine
        X, Y = np.eye(3)[:2]
        return np.array([turned(v, k, float(sine), float(normal[2])) for v in (X, Y)])

    def to_axes(self, points_mm: Float) -> Float:
        """Return the coordinates along `axes` and `normal` of points (…, 3) in the grid's axes."""
        return np.asarray((points_mm - [0.0, 0.0, self.shift_mm]) @ np.vstack([self.axes, self.normal]).T)

    def met(self, calibrated_mm: Float, centre_mm: Float) -> Float:
        """Return the points in space (…, 3) where the rays of calibrated points (…, 2) meet the surface."""
        reach = self._numerator(centre_mm) / self._denominator(calibrated_mm, centre_mm)
        return np.asarray(centre_mm + reach[..., None] * (_in_space(calibrated_mm) - centre_mm))

    def within(self, calibrated_mm: Float, centre_mm: Float) -> Float:
        """Return the positions of calibrated points on the surface, in coordinates along `axes`.

        Distances computed from these coordinates are true distances on the surface.

        Parameters
        ----------
        calibrated_mm : ndarray, shape (…, 2)
            Points where the rays of the camera meet the grid's plane.
        centre_mm : ndarray, shape (3,)
            The camera's centre in the grid's axes.

        Returns
        -------
        ndarray, shape (…, 2)
            Coordinates in mm. The origin is the point of the plane that lies above or below the grid's
            centre.
        """
        # These are the points of `met`, but the third coordinate of calibrated points is 0 and not computed.
        axes, m = self.axes, np.asarray(calibrated_mm, np.float64)
        reach = self._numerator(centre_mm) / self._denominator(m, centre_mm)
        origin = axes @ (centre_mm - np.array([0.0, 0.0, self.shift_mm]))
        return np.asarray(reach[..., None] * (m @ axes[:, :2].T - axes @ centre_mm) + origin)

    def jacobian(self, calibrated_mm: Float, centre_mm: Float) -> Float:
        """Return the derivative of `within` with respect to the calibrated points, shape (…, 2, 2)."""
        denominator = self._denominator(calibrated_mm, centre_mm)
        reach = self._numerator(centre_mm) / denominator
        to_grid = _in_space(calibrated_mm) - centre_mm
        slopes = np.array([self.slope_x, self.slope_y])
        in_space = (
            reach[..., None, None] * np.eye(3)[:, :2]
            - (reach / denominator)[..., None, None] * to_grid[..., :, None] * slopes
        )
        return np.asarray(self.axes @ in_space)

    def derivatives(self, calibrated_mm: Float, centre_mm: Float) -> Float:
        """Return the derivatives of `within` with respect to slope x, slope y and shift, shape (…, 2, 3)."""
        axes, m = self.axes, np.asarray(calibrated_mm, np.float64)
        numerator, denominator = self._numerator(centre_mm), self._denominator(m, centre_mm)
        beside = m - centre_mm[:2]
        of_slopes = (centre_mm[:2] * denominator[..., None] + numerator * beside) / denominator[
            ..., None
        ] ** 2
        of_reach = -np.concatenate([of_slopes, 1.0 / denominator[..., None]], axis=-1)
        to_grid = beside @ axes[:, :2].T - axes[:, 2] * centre_mm[2]
        found = to_grid[..., :, None] * of_reach[..., None, :]
        found[..., 2] -= axes[:, 2]
        above = self.met(m, centre_mm) - [0.0, 0.0, self.shift_mm]
        for k, step in enumerate(_STEP * np.eye(2)):
            ahead, behind = (
                replace(self, slope_x=self.slope_x + x, slope_y=self.slope_y + y).axes
                for x, y in (step, -step)
            )
            found[..., k] += above @ (ahead - behind).T / (2 * _STEP)
        return np.asarray(found)

    def _numerator(self, centre_mm: Float) -> float:
        x, y, z = centre_mm
        return float(z - self.shift_mm - self.slope_x * x - self.slope_y * y)

    def _denominator(self, calibrated_mm: Float, centre_mm: Float) -> Float:
        x, y, z = centre_mm
        m = np.asarray(calibrated_mm)
        return np.asarray(z + self.slope_x * (m[..., 0] - x) + self.slope_y * (m[..., 1] - y))


def _in_space(calibrated_mm: Float) -> Float:
    m = np.asarray(calibrated_mm, np.float64)
    return np.concatenate([m, np.zeros((*m.shape[:-1], 1))], axis=-1)


def turned(v: Float, k: Float, sine: float, cosine: float) -> Float:
    """Return the vector `v` (3,), turned anticlockwise about the unit vector `k` by Rodrigues' formula."""
    # Do not use `np.cross`, which takes ten times as long for two single vectors.
    (a, b, c), (x, y, z) = k, v
    across = np.array([b * z - c * y, c * x - a * z, a * y - b * x])
    return np.asarray(v * cosine + across * sine + k * (k @ v) * (1.0 - cosine))


def moved_out_of_plane(
    calibrated: Displacement, centre_mm: Float, before: Plane, after: Plane
) -> Displacement:
    """Return the displacement within the surface of a specimen that moved from one plane to another.

    `calibrated`: displacement on the grid's plane, mm. `centre_mm`, shape (3,): the camera's centre in the
    grid's axes. `before`, `after`: planes of the surface in the reference and in the deformed image.
    """
    here_mm, there_mm = calibrated.position, calibrated.position + calibrated.vector
    position, moved = before.within(here_mm, centre_mm), after.within(there_mm, centre_mm)
    gradient, noise = calibrated.gradient, calibrated.noise
    there = after.jacobian(there_mm, centre_mm)
    covariance: Float = np.broadcast_to(np.nan, (*there.shape[:-2], 4, 4))
    if gradient is not None:
        back = np.linalg.inv(before.jacobian(here_mm, centre_mm))
        gradient = there @ (gradient + np.eye(2)) @ back - np.eye(2)
        if noise is not None:
            both = np.einsum("...ik,...lj->...ijkl", there, back).reshape(covariance.shape)
            covariance = both @ noise.gradient @ np.swapaxes(both, -1, -2)
    if noise is not None:
        noise = noise.mapped(there, covariance)
    return replace(calibrated, position=position, vector=moved - position, gradient=gradient, noise=noise)
