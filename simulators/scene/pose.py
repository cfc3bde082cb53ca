"""Rigid motions of a surface in the world."""

from dataclasses import dataclass, field
from math import atan, hypot, radians, tan

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Pose:
    """A rigid motion ``p -> rotation · p + translation_mm``. The default is no motion."""

    rotation: Array = field(default_factory=lambda: np.eye(3))  # shape (3, 3)
    translation_mm: Array = field(default_factory=lambda: np.zeros(3))  # shape (3,)

    def apply(self, points_mm: Array) -> Array:
        """Return the moved points (n, 3) in mm."""
        return points_mm @ self.rotation.T + self.translation_mm

    def after(self, first: "Pose") -> "Pose":
        """Return the rigid motion that does `first`, and then this motion."""
        return Pose(
            self.rotation @ first.rotation, self.rotation @ first.translation_mm + self.translation_mm
        )

    def inverse(self) -> "Pose":
        """Return the inverse motion."""
        return Pose(self.rotation.T, -self.rotation.T @ self.translation_mm)

    @classmethod
    def turned(cls, axis: Array, angle_deg: float, through_mm: Array) -> "Pose":
        """Return the right-handed rotation about an axis through a point (3,) in mm.

        `axis` is a direction (3,) of any length.
        """
        rotation = _rotation(axis / np.linalg.norm(axis), radians(angle_deg))
        return cls(rotation, through_mm - rotation @ through_mm)

    @classmethod
    def sloped(cls, slope_x_deg: float, slope_y_deg: float, shift_z_mm: float = 0.0) -> "Pose":
        """Return the smallest rotation, with a shift along z, that moves the plane z = 0 to the plane
        ``z = tan(slope_x) X + tan(slope_y) Y + shift_z``."""
        a, b = tan(radians(slope_x_deg)), tan(radians(slope_y_deg))
        steepest = hypot(a, b)
        tip = _rotation(np.array([b, -a, 0.0]) / steepest, atan(steepest)) if steepest > 0.0 else np.eye(3)
        return cls(tip, np.array([0.0, 0.0, shift_z_mm]))


def _rotation(axis: Array, angle: float) -> Array:
    """Return the rotation matrix (3, 3) for a unit axis and an angle in radians (Rodrigues' formula)."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross)
