"""A pinhole camera with radial distortion, looking at the grid's centre."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]


@dataclass(frozen=True)
class PinholeCamera:
    """The camera of the paper's numerical assessment.

    At rest it looks straight at the grid's centre, from `distance_mm` along Z. Pan turns the scene in front
    of it about the vertical axis, then tilt turns it about the horizontal one: ``R = Rx(tilt)·Ry(pan)``.
    That is the same as swinging the camera round the grid's centre at that distance.

    Attributes
    ----------
    focal_px : float
        Pinhole distance, in pixels.
    distance_mm : float
        From the pinhole to the grid's centre.
    pan_deg, tilt_deg : float
        Swing about the vertical and the horizontal axis.
    k1_per_px2 : float
        Radial distortion on the sensor: ``x_d = x_u·(1 + k1·r_u²)`` with r_u the undistorted distance from
        the principal point in px. Positive is pincushion, negative barrel.
    principal_px : tuple of float
        Where the optical axis meets the sensor.
    """

    focal_px: float = 2800.0
    distance_mm: float = 40.0
    pan_deg: float = 0.0
    tilt_deg: float = 0.0
    k1_per_px2: float = 0.0
    principal_px: tuple[float, float] = (0.0, 0.0)

    @property
    def rotation(self) -> NDArray[np.float64]:
        """The matrix (3, 3) from grid axes to camera axes, both X right, Y up, Z towards the camera."""
        pan, tilt = np.radians([self.pan_deg, self.tilt_deg])
        about_y = np.array([[np.cos(pan), 0, np.sin(pan)], [0, 1, 0], [-np.sin(pan), 0, np.cos(pan)]])
        about_x = np.array([[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]])
        rotation: NDArray[np.float64] = about_x @ about_y
        return rotation

    def project(self, points_mm: Points) -> Points:
        """Return where points appear on the sensor.

        Parameters
        ----------
        points_mm : ndarray, shape (n, 2) or (n, 3)
            X right, Y up, Z towards the camera; without Z they lie in the grid's plane.

        Returns
        -------
        ndarray, shape (n, 2)
            x right, y down, px.
        """
        rotation = self.rotation[:, : points_mm.shape[1]]
        seen = points_mm @ rotation.T
        depth_mm = self.distance_mm - seen[:, 2:]
        ideal = self.focal_px * seen[:, :2] * np.array([1.0, -1.0]) / depth_mm
        radius2 = (ideal**2).sum(axis=1, keepdims=True)
        projected: Points = ideal * (1 + self.k1_per_px2 * radius2) + np.array(self.principal_px)
        return projected
