"""A camera that moved between its calibration and the reference image of a test.

The surface of a specimen in the reference shows such a motion if two cameras see it: their rays to the same
points do not meet on a plane. A plane surface shows five of the six motions. The sixth, along the line
between the two cameras, looks like a surface at another distance. It scales all distances alike, which
changes no strain.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np

from dic.calibration.calibration import Calibration
from dic.calibration.one_grid import pinhole_of
from dic.typing import Float

_TURN, _SHIFT_MM = np.radians(1.0), 1.0
"""Standard deviations of the motions that are expected, about and along each axis."""

_SHARE = 0.1
"""Further motions are expected to be as small as this, if one is known to first order."""

_POSE = slice(7, 13)


@dataclass(frozen=True)
class CameraMotion:
    """The motion of a camera since its calibration, relative to another camera."""

    camera: Calibration
    """The camera in its present pose, as far as it is known; its covariance contains that of the motion."""
    expected: Float
    """Shape (6, 5). Five independent motions of the size that is expected: a small rotation of the camera's
    axes, rad, and a shift of its centre, mm.
    """
    motion: Float
    """Shape (6,). The rotation and the shift so far."""
    scale_std: float
    """Standard deviation of all distances, as a share of them."""

    @classmethod
    def unknown(cls, camera: Calibration, beside_mm: Float) -> "CameraMotion":
        """Return the motion of a camera before it is measured; `beside_mm` (3,) is the other's centre."""
        line = pinhole_of(camera).centre_mm - beside_mm
        length_mm = float(np.linalg.norm(line))
        # The first of these directions is that of the line.
        across = np.linalg.svd(line[:, None])[0][:, 1:]
        expected = np.zeros((6, 5))
        expected[:3, :3], expected[3:, 3:] = _TURN * np.eye(3), _SHIFT_MM * across
        return cls(camera, expected, np.zeros(6), _SHIFT_MM / length_mm)

    def factors(self, px: Float) -> tuple[Float, Float]:
        """Return the effects of the expected motions on mapped points (n, 2, 5) and on the centre (3, 5)."""
        pinhole = pinhole_of(self.camera)
        pose = np.zeros_like(pinhole.covariance)
        pose[_POSE, _POSE] = np.eye(6)
        no_deviations = np.zeros_like(pinhole.deviation_covariance)
        free = replace(pinhole, covariance=pose, deviation_covariance=no_deviations)
        return free.error_factors(px) @ self.expected, free.centre_factors() @ self.expected

    def changed(self, sizes: Float) -> "CameraMotion":
        """Return the motion with further motions of these sizes (5,), in units of the expected ones."""
        step, pinhole = self.expected @ sizes, pinhole_of(self.camera)
        moved = replace(
            pinhole,
            rotation=cv2.Rodrigues(step[:3])[0] @ pinhole.rotation,
            centre_mm=pinhole.centre_mm + step[3:],
        )
        return replace(self, camera=replace(self.camera, pinhole=moved), motion=self.motion + step)

    def known_to(self, covariance: Float) -> "CameraMotion":
        """Return the motion, of which the covariance (5, 5) is known in units of the expected ones."""
        pinhole = pinhole_of(self.camera)
        total = pinhole.covariance.copy()
        total[_POSE, _POSE] += self.expected @ covariance @ self.expected.T
        # The bicubic map is that of the camera before it moved.
        camera = replace(
            self.camera,
            pinhole=replace(pinhole, covariance=total),
            bicubic_cross_validation_px=float("nan"),
            model="pinhole",
        )
        return replace(self, camera=camera, expected=_SHARE * self.expected)

    def covariance(self, estimates: Float) -> Float:
        """Return the covariance (11, 11) of the estimates of `JointSystem` that the motion adds.

        It is not known which camera moved. If it was the first, the axes of the strain turned with it. The
        scale of all distances is not known either.
        """
        camera = pinhole_of(self.camera)
        spin = float((camera.rotation.T @ self.motion[:3])[2])
        quarter = np.array([[0.0, -1.0], [1.0, 0.0]])
        gradients = estimates[:8].reshape(2, 2, 2)
        slopes = quarter @ estimates[8:10]
        by_spin = np.array([*(quarter @ gradients - gradients @ quarter).ravel(), *slopes, 0.0])
        by_scale = np.append(np.zeros(10), estimates[10])
        return np.asarray(
            spin**2 * np.outer(by_spin, by_spin) + self.scale_std**2 * np.outer(by_scale, by_scale)
        )

    @property
    def size_text(self) -> str:
        """The size of the motion."""
        turn_deg, shift_mm = np.degrees(np.linalg.norm(self.motion[:3])), np.linalg.norm(self.motion[3:])
        return f"by about {turn_deg:.1g}° and {shift_mm:.1g} mm relative to the other"

    @property
    def text(self) -> str:
        """One sentence about the motion since the calibration, and what to do."""
        return (
            f"a camera was moved after its calibration, {self.size_text}: corrected strain takes account of "
            "it, but fasten its mount and calibrate again"
        )
