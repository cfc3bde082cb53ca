"""Find the plane of a specimen's surface in the reference images of two cameras, by parallax.

A calibration describes the plane of the grid. The surface of the specimen may lie elsewhere: behind the plate
that carries the grid, or tilted. If the second camera's reference image is correlated with the first
camera's, each material point has a position in both images. The difference of its two calibrated positions is
z e, where z is the point's height and e is the parallax per height (`dic.out_of_plane.parallax`). The vector
e depends on the distances of the cameras from the grid. A calibration may determine these distances badly. So
the errors of both calibrations are estimated together with the plane.
"""

from dataclasses import dataclass, replace

import numpy as np

from dic.calibration.calibration import Calibration
from dic.calibration.one_grid import looks_straight, of_one_grid, pinhole_of, shared_factors
from dic.correlation.field import Field
from dic.out_of_plane.moved_camera import CameraMotion
from dic.out_of_plane.plane import Plane
from dic.out_of_plane.reasons import lens_reason
from dic.typing import Float, Mask

_FEWEST_POINTS = 30
_STEPS = 12
_MOTION_STEPS = 2
"""Further steps for a motion that is known to first order."""
_CLOSE_MM = 1e-7

_ERROR_PX = 0.01
"""Standard deviation of each point's errors, in addition to noise, from the different directions of view."""

_OUTLIER = 6.0
"""Points whose residual is larger than this many times the median residual are left out."""

_AGREE_PX = 0.1
_IMPROBABLE = 6.0
"""Largest accepted values: rms residual, and adjustment of the calibrations in standard deviations."""

_MOVED = "a camera was moved after its calibration, so fasten its mount and calibrate again"
_TO_KNOW = "the motion can be measured if dic calibrate is given the distance or focal length"
_UNEXPLAINED = (
    "the calibrations contradict each other, and no motion of a camera explains it, so calibrate both "
    "cameras again, with the same grid"
)


@dataclass(frozen=True)
class ReferenceSurface:
    """The plane of a specimen's surface in the reference."""

    plane: Plane | None = None
    """The plane in the grid's axes, or None if it could not be found."""
    centres_mm: tuple[Float, Float] | None = None
    """Each of shape (3,). The centres of both cameras in the grid's axes, adjusted to the parallax."""
    problem: str = ""
    """The reason why the plane could not be found, or ""."""
    contradicted: bool = False
    """True if the cameras' calibrations contradict each other, so that no strain can be corrected."""
    moved: CameraMotion | None = None
    """The motion of the second camera relative to the first since their calibration, if they moved."""

    @property
    def text(self) -> str:
        """One sentence about the position of the surface."""
        if self.contradicted:
            return f"strain is not corrected by both cameras, because {self.problem}"
        if self.plane is None:
            return (
                f"the surface's distance from the grid's plane is not known, because {self.problem}; "
                "the surface is taken to lie in the grid's plane"
            )
        slopes = np.degrees(np.arctan([self.plane.slope_x, self.plane.slope_y]))
        moved = "" if self.moved is None else f"; {self.moved.text}"
        side = "behind" if self.plane.shift_mm <= 0 else "in front of"
        return (
            f"in the reference the surface lies {abs(self.plane.shift_mm):.3f} mm {side} the grid's plane, "
            f"with slopes of {slopes[0]:+z.3f}° and {slopes[1]:+z.3f}° along X and Y{moved}"
        )


def reference_surface(field: Field, calibrations: tuple[Calibration, Calibration]) -> ReferenceSurface:
    """Find the plane of the specimen's surface from the correlation of both reference images.

    `field`: displacements from the reference image of the first camera to the reference image of the second.
    `calibrations`: calibrations of the two cameras with the same grid; both have a pinhole model.
    """
    one, other = of_one_grid(calibrations)
    calibrations = one, other
    first_px = field.points
    second_px = first_px + np.stack([field.u_px, field.v_px], axis=-1).reshape(-1, 2)
    use = field.converged.ravel() & calibrations[0].inside(first_px) & calibrations[1].inside(second_px)
    if np.count_nonzero(use) < _FEWEST_POINTS:
        return ReferenceSurface(problem=f"the reference images share fewer than {_FEWEST_POINTS} points")
    noise_px = float(np.median(np.hypot(field.std_u_px, field.std_v_px).ravel()[use]))
    mm_per_px = calibrations[0].mm_per_px
    error_mm = np.hypot(noise_px, _ERROR_PX) * mm_per_px
    first, second = _View.of(one, first_px[use]), _View.of(other, second_px[use])
    shared = shared_factors(pinhole_of(one))
    found = _solve([first, second], shared, error_mm)
    problem = found.disagreement(mm_per_px)
    if not problem:
        return found.surface()
    lens = lens_reason(calibrations, _apart_mm(first, second) / mm_per_px)
    if lens:
        return ReferenceSurface(problem=lens, contradicted=True)
    if any(looks_straight(pinhole_of(calibration)) for calibration in calibrations):
        return ReferenceSurface(problem=f"{_MOVED}; {_TO_KNOW}: {problem}", contradicted=True)
    motion = CameraMotion.unknown(other, pinhole_of(one).centre_mm)
    found = _solve([first, _View.of(other, second_px[use], motion)], shared, error_mm)
    motion = motion.changed(found.motion).known_to(found.motion_covariance)
    for _ in range(_MOTION_STEPS):
        found = _solve([first, _View.of(motion.camera, second_px[use], motion)], shared, error_mm)
        motion = motion.changed(found.motion)
    if found.disagreement(mm_per_px):
        return ReferenceSurface(problem=f"{_UNEXPLAINED}: {problem}", contradicted=True)
    return replace(found.surface(), moved=motion)


@dataclass(frozen=True)
class _View:
    """The measurements of n points by one camera."""

    at_mm: Float
    """Shape (n, 2). Calibrated positions."""
    centre_mm: Float
    """Shape (3,). The camera's centre."""
    of_map: Float
    of_centre: Float
    """Shapes (n, 2, q) and (3, q). Effect of q independent errors of the calibration, with variance 1."""

    motions: int = 0
    """Number of errors, the first of all, that are motions of the camera since its calibration."""

    @classmethod
    def of(cls, calibration: Calibration, px: Float, motion: CameraMotion | None = None) -> "_View":
        best = pinhole_of(calibration)
        of_map, of_centre = best.error_factors(px), best.centre_factors()
        if motion is None:
            return cls(best.map(px), best.centre_mm, of_map, of_centre)
        by_motion, by_shift = motion.factors(px)
        of_map, of_centre = (
            np.concatenate(both, axis=-1) for both in ((by_motion, of_map), (by_shift, of_centre))
        )
        return cls(best.map(px), best.centre_mm, of_map, of_centre, by_shift.shape[1])

    def adjusted(self, sources: Float) -> "_View":
        """Return the view if the calibration has the errors `sources` (q,)."""
        moved = self.centre_mm + self.of_centre @ sources
        return replace(self, at_mm=self.at_mm + self.of_map @ sources, centre_mm=moved)

    @property
    def rise(self) -> Float:
        """Shift of the calibrated positions by a height of 1 mm, shape (n, 2)."""
        return np.asarray((self.at_mm - self.centre_mm[:2]) / self.centre_mm[2])

    def slopes(self, height_mm: Float) -> Float:
        """Derivative ∂/∂errors of the true position (without the height's shift), shape (n, 2, q)."""
        toward = self.of_centre[:2] + self.rise[:, :, None] * self.of_centre[2]
        away = (self.of_map - toward) / self.centre_mm[2]
        return np.asarray(self.of_map - height_mm[:, None, None] * away)


@dataclass(frozen=True)
class _Solution:
    """The plane, the errors of both calibrations, and the motion of the second camera if it is free."""

    views: tuple[_View, _View]
    """Both views, with the errors that are found."""
    values: Float
    normal: Float
    """Shapes (3 + q,) and (3 + q, 3 + q). Plane and errors, and their inverse covariance."""
    left_mm: Float
    use: Mask
    """Shape (n,). What is left of the distance of the points, and whether a point is used."""
    moves: slice
    """The values that are motions."""

    @property
    def motion(self) -> Float:
        """Motions of the second camera, in units of those expected."""
        return self.values[self.moves]

    @property
    def motion_covariance(self) -> Float:
        """Covariance of `motion`."""
        return np.asarray(np.linalg.inv(self.normal)[self.moves, self.moves])

    def surface(self) -> ReferenceSurface:
        """Return the plane and the centres of both cameras."""
        first, second = self.views
        # A height shifts the calibrated position of its point. The plane must be fitted at the true positions
        # of the points, so this shift is subtracted first.
        height = np.column_stack([first.at_mm, np.ones(len(self.use))]) @ self.values[:3]
        place = first.at_mm - first.rise * height[:, None]
        terms = np.column_stack([place, np.ones(len(place))])
        plane = np.linalg.lstsq(terms[self.use], height[self.use], rcond=None)[0]
        return ReferenceSurface(Plane(*map(float, plane)), (first.centre_mm, second.centre_mm))

    def disagreement(self, mm_per_px: float) -> str:
        """Return the reason why the two cameras do not agree on a plane, or "" if they do."""
        # Of many errors that the images measure, each needs an adjustment of about one standard deviation.
        errors = np.delete(np.arange(len(self.values)), self.moves)[3:]
        measured = len(errors) - float(np.diag(np.linalg.inv(self.normal))[errors].sum())
        adjustment = max(float(self.values[errors] @ self.values[errors]) - measured, 0.0) ** 0.5
        left_px = float(np.median(self.left_mm)) / mm_per_px
        if adjustment <= _IMPROBABLE and left_px <= _AGREE_PX:
            return ""
        return (
            f"the reference images agree on a plane only to {left_px:.2f} px (at most {_AGREE_PX:g} px is "
            f"explained) and with calibrations that are {adjustment:.0f} standard deviations off (at most "
            f"{_IMPROBABLE:.0f})"
        )


def _solve(views: list[_View], shared: int, error_mm: float) -> _Solution:
    """Estimate the plane and the errors of both calibrations by Gauss-Newton steps; leave out outliers."""
    # The errors of each calibration alone, and then those of the grid, which both share
    own = [np.arange(view.of_centre.shape[1] - shared) for view in views]
    count = len(own[0]) + len(own[1])
    grid = count + np.arange(shared)
    places = np.append(own[0], grid), np.append(len(own[0]) + own[1], grid)
    values, use = np.zeros(3 + count + shared), np.ones(len(views[0].at_mm), bool)
    prior = np.concatenate([np.zeros(3), np.ones(count + shared)])
    for _ in range(_STEPS):
        first, second = (v.adjusted(values[3:][of]) for v, of in zip(views, places, strict=True))
        terms = np.column_stack([first.at_mm, np.ones(len(use))])
        height = terms @ values[:3]
        left = first.at_mm - second.at_mm - height[:, None] * (first.rise - second.rise)
        by_plane = -(first.rise - second.rise)[:, :, None] * terms[:, None, :]
        by_errors = np.zeros((*first.at_mm.shape, count + shared))
        by_errors[:, :, places[0]] += first.slopes(height)
        by_errors[:, :, places[1]] -= second.slopes(height)
        design = np.concatenate([by_plane, by_errors], axis=2)[use].reshape(-1, len(values)) / error_mm
        normal = design.T @ design + np.diag(prior)
        step = np.linalg.solve(normal, design.T @ left[use].ravel() / error_mm + prior * values)
        values = values - step
        size = np.linalg.norm(left, axis=1)
        use = size <= max(_OUTLIER * float(np.median(size)), 2 * error_mm)
        if np.abs(step[:3]).max() < _CLOSE_MM:
            break
    moves = slice(3 + len(own[0]), 3 + len(own[0]) + views[1].motions)
    return _Solution((first, second), values, normal, size, use, moves)


def _apart_mm(first: _View, second: _View) -> float:
    """Return the rms distance between the calibrated positions of both cameras that no plane explains."""
    terms = np.column_stack([first.at_mm, np.ones(len(first.at_mm))])
    rise: Float = first.rise - second.rise
    design = (rise[:, :, None] * terms[:, None, :]).reshape(-1, 3)
    apart = (first.at_mm - second.at_mm).ravel()
    left = apart - design @ np.linalg.lstsq(design, apart, rcond=None)[0]
    return float(np.sqrt(2 * np.median(left**2)))
