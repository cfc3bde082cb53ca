"""Correct strain with two cameras, which measure the motion of the specimen's plane by parallax."""

from dataclasses import dataclass, replace

import numpy as np

from dic.calibration.calibration import Calibration
from dic.calibration.one_grid import of_one_grid
from dic.out_of_plane.camera_drift import drift_reason
from dic.out_of_plane.correction import Correction, points_of
from dic.out_of_plane.joint_solution import JointSolution, JointSystem
from dic.out_of_plane.parallax import Bulge, Heights, Pairs
from dic.out_of_plane.plane import Plane, moved_out_of_plane
from dic.out_of_plane.reasons import lens_reason
from dic.out_of_plane.reference_surface import ReferenceSurface
from dic.out_of_plane.uncertainty import Points
from dic.strain.displacement import Displacement
from dic.strain.measurement import Measurement
from dic.strain.strain import MeanStrain, strain_of_gradient
from dic.typing import Float

_FEWEST_PAIRS = 30
_LEAST_PARALLAX = np.tan(np.radians(5.0))
_AGREE = 3.0
"""Largest accepted disagreement of the cameras perpendicular to the parallax, as a multiple of the noise."""

_AGREE_PX = 0.01
"""Disagreement, px, that is accepted in addition to the noise, because both calibrations have errors."""

_IMPROBABLE = 6.0
"""Largest accepted adjustment of the calibrations, in standard deviations."""


@dataclass(frozen=True)
class TwoCameraStep:
    """One step of a test, corrected by both cameras together.

    Attributes
    ----------
    corrections : tuple of Correction
        The corrections of the first and the second camera.
    mean : MeanStrain or None
        Mean of both cameras' strains, weighted by the inverse variances. None if the step was not corrected.
    heights_mm, heights_std_mm : ndarray, shape (rows, columns), or None
        Height of each point of the first camera relative to its height in the reference image, and the
        standard deviation of the height. NaN where the second camera has no point.
    declined : str or None
        The reason why there is no correction, or None if the step was corrected.
    """

    corrections: tuple[Correction, Correction]
    mean: MeanStrain | None = None
    heights_mm: Float | None = None
    heights_std_mm: Float | None = None
    declined: str | None = None

    def __repr__(self) -> str:
        what = f"{self.mean}" if self.declined is None else f"declined: {self.declined}"
        return f"TwoCameraStep({what})"

    def outline(self) -> "TwoCameraStep":
        """Return the step without fields of points, which take most of the memory."""
        first, second = self.corrections
        both = first.outline(), second.outline()
        return replace(self, corrections=both, heights_mm=None, heights_std_mm=None)

    @property
    def plane(self) -> Plane | None:
        """The specimen's plane in this step, relative to its plane in the reference; None if not known."""
        return self.corrections[0].after

    @property
    def plane_std(self) -> Float | None:
        """Standard deviations of the plane's slope x, slope y and shift (mm)."""
        return self.corrections[0].after_std


def correct_with_two_cameras(
    measurements: tuple[Measurement, Measurement],
    calibrations: tuple[Calibration, Calibration],
    surface: ReferenceSurface | None = None,
) -> TwoCameraStep:
    """Measure the motion of the specimen's plane since the reference, and correct both cameras' strains.

    `measurements`: calibrated measurements of one step by two cameras. The first camera should be the more
    oblique one. `calibrations`: calibrations of the two cameras with the same grid. `surface`: place of the
    specimen's surface in the reference. Default: the grid's plane.
    """

    joint = solve_with_two_cameras(measurements, calibrations, surface)
    if isinstance(joint, str):
        first, second = (Correction.refused("two cameras", m, joint) for m in measurements)
        return TwoCameraStep((first, second), declined=joint)
    return step_of(measurements, joint)


def solve_with_two_cameras(
    measurements: tuple[Measurement, Measurement],
    calibrations: tuple[Calibration, Calibration],
    surface: ReferenceSurface | None = None,
) -> JointSolution | str:
    """Return the joint solution of `correct_with_two_cameras`, or the reason why there is none."""
    if any(calibration.pinhole is None for calibration in calibrations):
        return "a calibration knows no camera centre"
    if surface is not None and surface.contradicted:
        return surface.problem
    one, other = seen_calibrations(calibrations, surface)
    first, second = _points(measurements, (one, other), surface)
    if min(len(first.before_mm), len(second.before_mm)) < _FEWEST_PAIRS:
        return f"a camera has fewer than {_FEWEST_PAIRS} points"
    pairs = Pairs.of(first, second, measurements[1].field)
    if len(pairs.chosen) < _FEWEST_PAIRS:
        return f"the cameras share {len(pairs.chosen)} points, at least {_FEWEST_PAIRS} are needed"
    if not (first.determine(1) and second.determine(1)):
        return "the points lie on one line"
    objection = _too_close(pairs, (first.centre_mm, second.centre_mm))
    if objection is not None:
        return objection
    system = JointSystem.of(pairs)
    objection = drift_reason(system) if surface is not None and surface.plane is not None else None
    if objection is not None:
        return objection
    joint = system.solve()
    if surface is not None and surface.moved is not None:
        joint = replace(joint, covariance=joint.covariance + surface.moved.covariance(joint.estimates))
    objection = _disagreement(pairs, joint, calibrations[0].mm_per_px)
    if objection is not None:
        return lens_reason((one, other), _apart_px(pairs, calibrations[0].mm_per_px)) or objection
    return joint


def seen_calibrations(
    calibrations: tuple[Calibration, Calibration], surface: ReferenceSurface | None
) -> tuple[Calibration, Calibration]:
    """Return the calibrations as both cameras together, and the surface in the reference, show them."""
    one, other = of_one_grid(calibrations)
    return (one, other) if surface is None or surface.moved is None else (one, surface.moved.camera)


def _points(
    measurements: tuple[Measurement, Measurement],
    calibrations: tuple[Calibration, Calibration],
    surface: ReferenceSurface | None,
) -> tuple[Points, Points]:
    """Return the points of both cameras, with displacements along the surface of the specimen."""
    plane = None if surface is None else surface.plane
    centres = (None, None) if surface is None or surface.centres_mm is None else surface.centres_mm
    first, second = (
        points_of(m, c, plane, centre)
        for m, c, centre in zip(measurements, calibrations, centres, strict=True)
    )
    return first, second


def _too_close(pairs: Pairs, centres_mm: tuple[Float, Float]) -> str | None:
    # Do not compute heights before this check, because two cameras at the same place cannot measure heights.
    rise, other = pairs.seen.rises(centres_mm)
    parallax = float(np.linalg.norm(rise - other, axis=1).mean())
    if parallax < _LEAST_PARALLAX:
        degrees = np.degrees(np.arctan(parallax))
        return f"the cameras look from directions only {degrees:.1f}° apart, at least 5° are needed"
    return None


def _disagreement(pairs: Pairs, joint: JointSolution, mm_per_px: float) -> str | None:
    if joint.shift_needed > _IMPROBABLE:
        return (
            f"the cameras measure the same strain only if their calibrations are {joint.shift_needed:.0f} "
            f"standard deviations off, at most {_IMPROBABLE:.0f} are accepted: was a camera moved?"
        )
    rms_mm = float(np.sqrt((Heights.of(pairs.seen, joint.system.centres_mm).across_mm ** 2).mean()))
    noise_mm = np.hypot(_noise_mm(pairs.first), _noise_mm(pairs.second))
    limit_mm = _AGREE * noise_mm + _AGREE_PX * mm_per_px
    if rms_mm > limit_mm:
        return (
            f"the cameras disagree by {rms_mm / mm_per_px:.3f} px rms across the parallax, "
            f"at most {limit_mm / mm_per_px:.3f} px is explained: was a camera moved?"
        )
    return None


def _apart_px(pairs: Pairs, mm_per_px: float) -> float:
    """Return by how much the cameras disagree at the edge of the field, before any adjustment, px."""
    system = JointSystem.of(pairs)
    gradients = system.estimates(system.centres_mm)[:8].reshape(2, 4)
    half_px = float(np.ptp(pairs.first.before_mm, axis=0).max()) / 2 / mm_per_px
    across_mm = Heights.of(pairs.seen, system.centres_mm).across_mm
    rms_px = float(np.sqrt((across_mm**2).mean())) / mm_per_px
    return max(rms_px, float(np.abs(gradients[0] - gradients[1]).max()) * half_px)


def _noise_mm(points: Points) -> float:
    """Return the standard deviation of displacements along one axis, as an rms value over all points."""
    noise = points.displacement.noise
    if noise is None:
        raise ValueError("the noise of these displacements is unknown")
    return float(np.sqrt((noise.factors[points.use] ** 2).sum(axis=(1, 2)).mean() / 2))


def step_of(measurements: tuple[Measurement, Measurement], joint: JointSolution) -> TwoCameraStep:
    """Return the corrections of both cameras, the mean strain and the heights of one step."""
    system, estimates, covariance = joint.system, joint.estimates, joint.covariance
    heights, plane = Heights.of(system.pairs.seen, system.centres_mm), Plane(*map(float, estimates[8:]))
    plane_std = np.sqrt(np.diag(covariance)[8:])
    settings, shared = measurements[0].strain_settings, len(system.pairs.chosen)
    corrections = []
    cameras = zip((system.pairs.first, system.pairs.second), system.centres_mm, strict=True)
    for k, (points, centre_mm) in enumerate(cameras):
        at = slice(4 * k, 4 * k + 4)
        mean = strain_of_gradient(estimates[at].reshape(2, 2), covariance[at, at], shared, settings.measure)
        moved = moved_out_of_plane(points.displacement, centre_mm, Plane(), plane)
        moved = _flattened(moved, points, centre_mm, heights)
        corrections.append(Correction("two cameras", mean, moved, settings, plane, plane_std))
    certainty = np.array([1.0 / np.trace(covariance[at, at]) for at in (slice(0, 4), slice(4, 8))])
    weigh = np.kron(certainty / certainty.sum(), np.eye(4))
    gradient, errors = weigh @ estimates[:8], weigh @ covariance[:8, :8] @ weigh.T
    mean = strain_of_gradient(gradient.reshape(2, 2), errors, shared, settings.measure)
    return TwoCameraStep((corrections[0], corrections[1]), mean, *_height_maps(system.pairs, heights))


def _flattened(moved: Displacement, points: Points, centre_mm: Float, heights: Heights) -> Displacement:
    """Return the displacements without those that the curvature of the surface causes."""
    bulge = Bulge.of(heights)
    rise_mm = bulge.at(points.after_mm) @ (bulge.weights @ heights.z_mm)
    vector = moved.vector.copy()
    vector[points.use] -= rise_mm[:, None] * (points.after_mm - centre_mm[:2]) / centre_mm[2]
    return replace(moved, vector=vector)


def _height_maps(pairs: Pairs, heights: Heights) -> tuple[Float, Float]:
    """Return heights on the first camera's grid, and their standard deviations due to noise alone."""
    first = pairs.first
    maps = [np.full(first.use.shape, np.nan) for _ in range(2)]
    rows, columns = (axis[pairs.chosen] for axis in np.nonzero(first.use))
    noise_mm = np.hypot(_noise_mm(first), _noise_mm(pairs.second))
    maps[0][rows, columns] = heights.z_mm
    maps[1][rows, columns] = noise_mm / np.linalg.norm(heights.parallax, axis=1)
    return maps[0], maps[1]
