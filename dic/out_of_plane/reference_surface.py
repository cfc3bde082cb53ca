"""Find the plane of a specimen's surface in the reference images of two cameras, by parallax.

A calibration describes the plane of the grid. The surface of the specimen may lie elsewhere: behind the plate
that carries the grid, or tilted. If the second camera's reference image is correlated with the first
camera's, each material point has a position in both images. The difference of its two calibrated positions is
z e, where z is the point's height and e is the parallax per height (`dic.out_of_plane.parallax`). The vector
e depends on the distances of the cameras from the grid. A calibration may determine these distances badly. So
the errors of both calibrations are estimated together with the plane.
"""

from dataclasses import dataclass

import numpy as np

from dic.calibration.calibration import Calibration
from dic.calibration.one_grid import of_one_grid, shared_factors
from dic.correlation.field import Field
from dic.out_of_plane.plane import Plane
from dic.out_of_plane.reasons import lens_reason
from dic.typing import Float

_FEWEST_POINTS = 30
_STEPS = 12
_CLOSE_MM = 1e-7

_ERROR_PX = 0.01
"""Standard deviation of each point's errors, in addition to noise, from the different directions of view."""

_OUTLIER = 6.0
"""Points whose residual is larger than this many times the median residual are left out."""

_AGREE_PX = 0.1
_IMPROBABLE = 6.0
"""Largest accepted values: rms residual, and adjustment of the calibrations in standard deviations."""


@dataclass(frozen=True)
class ReferenceSurface:
    """The plane of a specimen's surface in the reference."""

    plane: Plane | None = None
    """The plane in the grid's axes, or None if it could not be found."""
    centres_mm: tuple[Float, Float] | None = None
    """Each of shape (3,). The centres of both cameras in the grid's axes, adjusted to the parallax."""
    problem: str = ""
    """The reason why the plane could not be found, or ""."""
    apart_px: float = 0.0
    """Disagreement of the cameras that made it impossible to find the plane, px."""

    @property
    def text(self) -> str:
        """One sentence about the position of the surface."""
        if self.plane is None:
            return (
                f"the surface's distance from the grid's plane is not known, because {self.problem}; "
                "the surface is taken to lie in the grid's plane"
            )
        slopes = np.degrees(np.arctan([self.plane.slope_x, self.plane.slope_y]))
        side = "behind" if self.plane.shift_mm <= 0 else "in front of"
        return (
            f"in the reference the surface lies {abs(self.plane.shift_mm):.3f} mm {side} the grid's plane, "
            f"with slopes of {slopes[0]:+z.3f}° and {slopes[1]:+z.3f}° along X and Y"
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
    error_mm = np.hypot(noise_px, _ERROR_PX) * calibrations[0].mm_per_px
    views = [
        _View.of(calibration, px[use])
        for calibration, px in zip(calibrations, (first_px, second_px), strict=True)
    ]
    shared = 0 if one.pinhole is None else shared_factors(one.pinhole)
    found = _solve(views, shared, error_mm, calibrations[0].mm_per_px)
    if found.plane is not None:
        return found
    return ReferenceSurface(problem=lens_reason(calibrations, found.apart_px) or found.problem)


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

    @classmethod
    def of(cls, calibration: Calibration, px: Float) -> "_View":
        best = calibration.using("pinhole")
        if best.pinhole is None:
            raise ValueError("this calibration knows no camera centre")
        return cls(
            best.map(px), best.pinhole.centre_mm, best.error_factors(px), best.pinhole.centre_factors()
        )

    def adjusted(self, sources: Float) -> "_View":
        """Return the view if the calibration has the errors `sources` (q,)."""
        moved = self.centre_mm + self.of_centre @ sources
        return _View(self.at_mm + self.of_map @ sources, moved, self.of_map, self.of_centre)

    @property
    def rise(self) -> Float:
        """Shift of the calibrated positions by a height of 1 mm, shape (n, 2)."""
        return np.asarray((self.at_mm - self.centre_mm[:2]) / self.centre_mm[2])

    def slopes(self, height_mm: Float) -> Float:
        """Derivative ∂/∂errors of the true position (without the height's shift), shape (n, 2, q)."""
        toward = self.of_centre[:2] + self.rise[:, :, None] * self.of_centre[2]
        away = (self.of_map - toward) / self.centre_mm[2]
        return np.asarray(self.of_map - height_mm[:, None, None] * away)


def _solve(views: list[_View], shared: int, error_mm: float, mm_per_px: float) -> ReferenceSurface:
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
    # Of many errors that the images measure, each needs an adjustment of about one standard deviation.
    measured = len(values) - 3 - float(np.diag(np.linalg.inv(normal))[3:].sum())
    adjustment = max(float(values[3:] @ values[3:]) - measured, 0.0) ** 0.5
    problem = _disagreement(adjustment, float(np.median(size)) / mm_per_px)
    if problem:
        return ReferenceSurface(problem=problem, apart_px=_apart_mm(views) / mm_per_px)
    # A height shifts the calibrated position of its point. The plane must be fitted at the true positions of
    # the points, so this shift is subtracted first.
    place = first.at_mm - first.rise * height[:, None]
    plane = np.linalg.lstsq(np.column_stack([place, np.ones(len(place))])[use], height[use], rcond=None)[0]
    return ReferenceSurface(Plane(*map(float, plane)), (first.centre_mm, second.centre_mm))


def _apart_mm(views: list[_View]) -> float:
    """Return the rms distance between the calibrated positions of both cameras that no plane explains."""
    first, second = views
    terms = np.column_stack([first.at_mm, np.ones(len(first.at_mm))])
    rise: Float = first.rise - second.rise
    design = (rise[:, :, None] * terms[:, None, :]).reshape(-1, 3)
    apart = (first.at_mm - second.at_mm).ravel()
    left = apart - design @ np.linalg.lstsq(design, apart, rcond=None)[0]
    return float(np.sqrt(2 * np.median(left**2)))


def _disagreement(adjustment: float, left_px: float) -> str:
    """Return the reason why the two cameras do not agree on a plane, or "" if they do."""
    if adjustment <= _IMPROBABLE and left_px <= _AGREE_PX:
        return ""
    return (
        f"the cameras agree on it only to {left_px:.2f} px (at most {_AGREE_PX:g} px is explained) and with "
        f"calibrations that are {adjustment:.0f} standard deviations off (at most {_IMPROBABLE:.0f}): a "
        "camera was moved after its calibration, so fasten its mount and calibrate again"
    )
