"""Rotation seen by one camera: the misalignment of stage and specimen, told from strain by rigidity.

A turn about the grid's normal keeps the height of every point, so any two of its steps differ by an exactly
affine motion, in which a tilt looks like nothing but strain. A rotated specimen, however, has none. So the
slopes of the specimen at the reference and of the stage's axis, four numbers for the whole run, are found for
which no step has strain.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dic.out_of_plane.alignment import Alignment
from dic.out_of_plane.weights import Points
from dic.strain_fit import gradient_weights, slopes_of

Float = NDArray[np.float64]

PRIOR_SLOPE = np.tan(np.radians(1.0))
"""Standard deviation of all four slopes before anything was measured: they are some tenths of a degree. It
decides only what the images do not tell, such as all of it for a camera that looks straight on."""

_SYSTEMATIC = 3e-6
"""Strain errors that nothing else accounts for, such as the spline's; keeps the weights finite."""

_STEPS = 10
_SMALL = 1e-6
_CLOSE = 1e-9


@dataclass(frozen=True)
class Steps:
    """The steps of a rotation as the solve needs them.

    Attributes
    ----------
    points : sequence of Points
        Of each step.
    angles_deg : ndarray, shape (steps,)
        By which the specimen was turned since the reference.
    pivot_mm : ndarray, shape (2,)
    """

    points: Sequence[Points]
    angles_deg: Float
    pivot_mm: Float

    @classmethod
    def of(cls, points: Sequence[Points]) -> "Steps":
        """Take the angles and the pivot from the calibrated motions themselves."""
        angles, systems, sides = [], [], []
        for step in points:
            gradient, before, after = _plane_motion(step)
            F = gradient + np.eye(2)
            angle = np.arctan2(F[1, 0] - F[0, 1], F[0, 0] + F[1, 1])
            c, s = np.cos(angle), np.sin(angle)
            R = np.array([[c, -s], [s, c]])
            angles.append(np.degrees(angle))
            # The pivot x stays where it is: x = after + R (x - before).
            systems.append(np.eye(2) - R)
            sides.append(after - R @ before)
        pivot = np.linalg.lstsq(np.concatenate(systems), np.concatenate(sides), rcond=None)[0]
        return cls(points, np.array(angles), pivot)

    def gradients(self, slopes: Float, centre_mm: Float) -> Float:
        """Return the mean gradients within the specimen's plane, shape (steps, 2, 2)."""
        alignment = Alignment(slopes, np.zeros((4, 4)), self.pivot_mm)
        before, gradients = alignment.before, []
        for points, angle_deg in zip(self.points, self.angles_deg, strict=True):
            position = before.within(points.before_mm, centre_mm)
            moved = alignment.after(angle_deg).within(points.after_mm, centre_mm) - position
            gradients.append(slopes_of(position, moved))
        return np.array(gradients)

    def strains(self, slopes: Float, centre_mm: Float) -> Float:
        """Return the mean strains xx, yy, xy (Green-Lagrange) of all steps in a row, (3 steps,)."""
        F = self.gradients(slopes, centre_mm) + np.eye(2)
        E = (np.swapaxes(F, 1, 2) @ F - np.eye(2)) / 2
        return np.stack([E[:, 0, 0], E[:, 1, 1], E[:, 0, 1]], axis=1).ravel()


def _plane_motion(points: Points) -> tuple[Float, Float, Float]:
    """Return the mean gradient (2, 2) of calibrated points, and their centres before and after, (2,)."""
    gradient = slopes_of(points.before_mm, points.after_mm - points.before_mm)
    return gradient, points.before_mm.mean(axis=0), points.after_mm.mean(axis=0)


def by_gradient(gradient: Float) -> Float:
    """Return the derivative (3, 4) of the Green-Lagrange strains xx, yy, xy by the gradient's elements."""
    F = gradient + np.eye(2)
    return np.array(
        [
            [F[0, 0], 0.0, F[1, 0], 0.0],
            [0.0, F[0, 1], 0.0, F[1, 1]],
            [F[0, 1] / 2, F[0, 0] / 2, F[1, 1] / 2, F[1, 0] / 2],
        ]
    )


def gradient_covariance(steps: Steps) -> Float:
    """Return the covariance (4 steps, 4 steps) of all mean gradients, from noise and calibration.

    The noise of the reference image is half of that of each step and common to all of them.
    """
    noises, factors = [], []
    for points in steps.points:
        weights = gradient_weights(points.before_mm)
        noises.append(points.noise_covariance(weights))
        factors.append(points.calibration_factors(weights))
    n = len(noises)
    total = np.kron(np.ones((n, n)), np.mean(noises, axis=0) / 2)
    for k, noise in enumerate(noises):
        at = slice(4 * k, 4 * k + 4)
        total[at, at] += noise / 2
    shared = np.concatenate(factors)
    return np.asarray(total + shared @ shared.T + _SYSTEMATIC**2 * np.eye(4 * n))


def solve_alignment(
    steps: Steps, centre_mm: Float, covariance: Float, start: Float | None = None
) -> tuple[Float, Float, Float] | None:
    """Find the slopes that leave no strain, by least squares weighted with the strains' covariance.

    Parameters
    ----------
    steps : Steps
    centre_mm : ndarray, shape (3,)
        The camera's centre in the grid's axes.
    covariance : ndarray, shape (3 steps, 3 steps)
        Of the mean strains.
    start : ndarray, shape (4,), optional
        Slopes that are known to be near.

    Returns
    -------
    slopes : ndarray, shape (4,)
    gain : ndarray, shape (4, 3 steps)
        By which errors of the strains, changed in sign, enter the slopes.
    by_slope : ndarray, shape (3 steps, 4)
        Derivative of the strains by the slopes.

    Instead of all, None if no slopes are found: seen straight on, tilts make no false strain that would tell.
    """
    slopes = np.zeros(4) if start is None else start
    prior = np.eye(4) / PRIOR_SLOPE**2
    for _ in range(_STEPS):
        strains = steps.strains(slopes, centre_mm)
        by_slope = np.column_stack(
            [
                (steps.strains(slopes + d, centre_mm) - steps.strains(slopes - d, centre_mm)) / (2 * _SMALL)
                for d in _SMALL * np.eye(4)
            ]
        )
        weighted = np.linalg.solve(covariance, by_slope).T
        gain = np.linalg.inv(weighted @ by_slope + prior) @ weighted
        # The prior pulls towards 0: the whole of the slopes enters, not the step alone.
        step = gain @ (by_slope @ slopes - strains) - slopes
        slopes = slopes + step
        if np.abs(step).max() < _CLOSE:
            return slopes, gain, by_slope
    return None
