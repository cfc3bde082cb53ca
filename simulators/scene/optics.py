"""A pinhole camera with radial distortion that looks at the middle of the grid from any direction."""

from dataclasses import dataclass
from math import cos, radians, sin

import numpy as np
from numpy.typing import NDArray

from simulators.scene.jit import compiled

Array = NDArray[np.float64]

# Barrel distortion, k < 0: the distorted radius r_d = r (1 + k r²) increases with the radius r only up to r²
# = 1 / (3|k|). At this largest radius, r_d = (2/3) r and k r_d² = -4/27.
FOLD = -4.0 / 27.0


@dataclass(frozen=True)
class PinholeCamera:
    """A camera that looks at the world's origin and has its principal point in the middle of the image.

    In world coordinates in mm, X points right, Y points up and Z points towards the on-axis camera. In image
    coordinates in px, x points right and y points down, and pixel centres have integer coordinates. The pan
    angle turns the camera about the world's Y axis towards +X. After the pan, the tilt angle raises the
    camera towards +Y. The centre of the camera is ``distance · (sin pan · cos tilt, sin tilt, cos pan · cos
    tilt)``, and the camera has no roll. The distortion model is that of Helm and Deaner: ``x_distorted = x (1
    + k1 r²)``, where x and the radius r are in px from the principal point.

    Parameters
    ----------
    width_px, height_px : int
    focal_px : float
        Distance from the pinhole to the sensor in px.
    distance_mm : float
        Distance from the pinhole to the world's origin.
    pan_deg, tilt_deg : float
    k1_per_px2 : float
        The distortion k1 in 1/px², positive for pincushion and negative for barrel distortion.

    Raises
    ------
    ValueError
        If the barrel distortion is so strong that the model has no ray for the corners of the image.
    """

    width_px: int
    height_px: int
    focal_px: float = 2800.0
    distance_mm: float = 40.0
    pan_deg: float = 0.0
    tilt_deg: float = 0.0
    k1_per_px2: float = 0.0

    def __post_init__(self) -> None:
        corner_px2 = float(np.sum(self.principal_point_px**2))
        if self.k1_per_px2 * corner_px2 <= FOLD:
            raise ValueError(
                f"k1_per_px2 = {self.k1_per_px2:g} folds the image over before its corners; "
                f"it must exceed {FOLD / corner_px2:.3g} for {self.width_px} x {self.height_px} px"
            )

    @property
    def principal_point_px(self) -> Array:
        """Principal point in the middle of the image, in px, shape (2,)."""
        return np.array([(self.width_px - 1) / 2, (self.height_px - 1) / 2])

    @property
    def axes(self) -> Array:
        """Unit vectors right, up and back (from scene to camera) in the world, as rows of a (3, 3) array."""
        pan, tilt = radians(self.pan_deg), radians(self.tilt_deg)
        right = np.array([cos(pan), 0.0, -sin(pan)])
        back = np.array([sin(pan) * cos(tilt), sin(tilt), cos(pan) * cos(tilt)])
        return np.array([right, np.cross(back, right), back])

    @property
    def centre_mm(self) -> Array:
        """Position of the pinhole in the world in mm, shape (3,)."""
        return np.asarray(self.distance_mm * self.axes[2])

    def project(self, world_mm: Array) -> Array:
        """Return the image positions (n, 2) in px of world points (n, 3) in mm."""
        x, y, depth = ((world_mm - self.centre_mm) @ self.axes.T * [1.0, -1.0, -1.0]).T
        undistorted = self.focal_px * np.stack([x / depth, y / depth], axis=1)
        r2 = np.sum(undistorted**2, axis=1, keepdims=True)
        return np.asarray(undistorted * (1.0 + self.k1_per_px2 * r2) + self.principal_point_px)

    def ray(self, px: Array) -> tuple[Array, Array]:
        """Return the rays of image points (n, 2) in px: the pinhole (3,) in mm and the directions (n, 3).

        The directions are not normalised.
        """
        directions = _directions(
            np.ascontiguousarray(px - self.principal_point_px), self.k1_per_px2, self.focal_px, self.axes
        )
        return self.centre_mm, directions


@compiled
def _undistorted_scale(distorted_px2: float, k1_per_px2: float) -> float:
    """Return the ratio s = r / r_distorted of undistorted and distorted radius, from r_distorted squared.

    With k = k1 r_distorted², the distortion model is s + k s³ = 1. Newton's method starts at s = 1. For both
    signs of k it approaches the root from one side only.
    """
    k = k1_per_px2 * distorted_px2
    s = 1.0
    for _ in range(50):
        step = (s + k * s * s * s - 1.0) / (1.0 + 3.0 * k * s * s)
        s -= step
        if abs(step) < 1e-15:
            break
    return s


@compiled
def _directions(distorted_px: Array, k1_per_px2: float, focal_px: float, axes: Array) -> Array:
    """Return the directions (n, 3) of the rays through points (n, 2) in px from the principal point."""
    right, up, back = axes
    directions = np.empty((len(distorted_px), 3))
    for i in range(len(distorted_px)):
        x, y = distorted_px[i, 0], distorted_px[i, 1]
        scale = _undistorted_scale(x * x + y * y, k1_per_px2) / focal_px
        for axis in range(3):
            directions[i, axis] = scale * (x * right[axis] - y * up[axis]) - back[axis]
    return directions
