"""The correction by two cameras: the motion of the specimen's plane, measured by parallax."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dic.calibration import Calibration
from dic.measurement import Measurement
from dic.out_of_plane.correction import Correction, by_centre, centre_factors, points_of
from dic.out_of_plane.parallax import Heights, Pairs
from dic.out_of_plane.plane import Plane, moved_out_of_plane
from dic.out_of_plane.weights import Points
from dic.strain import MeanStrain, strain_of_gradient
from dic.strain_fit import gradient_weights, slopes_of

Float = NDArray[np.float64]

_FEWEST_PAIRS = 30
_LEAST_PARALLAX = np.tan(np.radians(5.0))
_AGREE = 3.0
"""Differences of both cameras across the parallax are borne up to this many times what noise explains."""

_AGREE_PX = 0.01
"""The same for what is no noise: both calibrations' own errors."""

_SYSTEMATIC = 5e-6
"""How far the strains of one set of points may differ between the cameras for reasons unaccounted for."""

_STEPS = 3
_SMALL = 1e-6


@dataclass(frozen=True)
class TwoCameraStep:
    """One step as both cameras see it together.

    Attributes
    ----------
    corrections : tuple of Correction
        Of the first and the second camera.
    mean : MeanStrain or None
        Of both cameras together, each weighted by its certainty; None if the correction was declined.
    heights_mm, heights_std_mm : ndarray, shape (rows, columns), or None
        Height of each point of the first camera over the reference's plane, NaN where the second sees none.
    declined : str or None
        Why the data were left alone.
    """

    corrections: tuple[Correction, Correction]
    mean: MeanStrain | None = None
    heights_mm: Float | None = None
    heights_std_mm: Float | None = None
    declined: str | None = None

    @property
    def plane(self) -> Plane | None:
        """Where the specimen's plane is, relative to the reference."""
        return self.corrections[0].after

    @property
    def plane_std(self) -> Float | None:
        """Standard deviations of slope x, slope y and shift (mm)."""
        return self.corrections[0].after_std


def correct_with_two_cameras(
    measurements: tuple[Measurement, Measurement], calibrations: tuple[Calibration, Calibration]
) -> TwoCameraStep:
    """Measure how the specimen's plane moved since the reference and correct both cameras' strains for it.

    Parameters
    ----------
    measurements : tuple of Measurement
        Of the same step by two cameras, calibrated. The first should be the one that stands further aside.
    calibrations : tuple of Calibration
        Of the two cameras, on the same grid.
    """

    def declined(reason: str) -> TwoCameraStep:
        first, second = (Correction.refused("two cameras", m, reason) for m in measurements)
        return TwoCameraStep((first, second), declined=reason)

    if any(calibration.pinhole is None for calibration in calibrations):
        return declined("a calibration knows no camera centre")
    first, second = (points_of(m, c) for m, c in zip(measurements, calibrations, strict=True))
    if min(len(first.before_mm), len(second.before_mm)) < _FEWEST_PAIRS:
        return declined(f"a camera has fewer than {_FEWEST_PAIRS} points")
    pairs = Pairs.of(first, second, measurements[1].field)
    if len(pairs.chosen) < _FEWEST_PAIRS:
        return declined(f"the cameras share {len(pairs.chosen)} points, at least {_FEWEST_PAIRS} are needed")
    if not (first.determine(1) and second.determine(1)):
        return declined("the points lie on one line")
    both = _Both.of(pairs, calibrations)
    objection = _objection(pairs, Heights.of(pairs, both.centres_mm), calibrations[0].mm_per_px)
    return declined(objection) if objection is not None else both.step(measurements)


def _objection(pairs: Pairs, heights: Heights, mm_per_px: float) -> str | None:
    parallax = float(np.linalg.norm(heights.parallax, axis=1).mean())
    if parallax < _LEAST_PARALLAX:
        degrees = np.degrees(np.arctan(parallax))
        return f"the cameras look from directions only {degrees:.1f}° apart, at least 5° are needed"
    rms_mm = float(np.sqrt((heights.across_mm**2).mean()))
    noise_mm = np.hypot(_noise_mm(pairs.first), _noise_mm(pairs.second))
    limit_mm = _AGREE * noise_mm + _AGREE_PX * mm_per_px
    if rms_mm > limit_mm:
        return (
            f"the cameras disagree by {rms_mm / mm_per_px:.3f} px rms across the parallax, "
            f"at most {limit_mm / mm_per_px:.3f} px is explained: was one of them moved?"
        )
    return None


def _noise_mm(points: Points) -> float:
    """Return the standard deviation of a displacement along one axis, rms of all points."""
    noise = points.displacement.noise
    if noise is None:
        raise ValueError("these displacements come without their noise")
    return float(np.sqrt((noise.spread[points.use] ** 2).sum(axis=(1, 2)).mean() / 2))


@dataclass(frozen=True)
class _Both:
    """Both cameras of a step, and how errors reach their corrected gradients and the plane.

    All estimates stand in one row: the gradients' elements of the first and the second camera, of the points
    that both see, then slope x, slope y and shift of the plane, eleven in all.

    A camera that looks straight on hardly knows its distance, and a wrong one makes the cameras disagree on
    the strain of these points. So both centres are adjusted within their own uncertainty until they agree.
    """

    pairs: Pairs
    calibrations: tuple[Calibration, Calibration]
    centres_mm: tuple[Float, Float]

    @classmethod
    def of(cls, pairs: Pairs, calibrations: tuple[Calibration, Calibration]) -> "_Both":
        """Begin with the centres as calibrated."""
        first, second = (c.pinhole.centre_mm for c in calibrations if c.pinhole is not None)
        return cls(pairs, calibrations, (first, second))

    def estimates(self, centres_mm: tuple[Float, Float]) -> Float:
        """Return all estimates (11,) for cameras at these centres."""
        plane, _ = Heights.of(self.pairs, centres_mm).plane()
        start = self.pairs.first.before_mm[self.pairs.chosen]
        gradients = [
            slopes_of(start, plane.within(after_mm, centre_mm) - start)
            for after_mm, centre_mm in zip(self.pairs.positions_mm(), centres_mm, strict=True)
        ]
        return np.array([*np.ravel(gradients), plane.slope_x, plane.slope_y, plane.shift_mm])

    def by_centres(self) -> Float:
        """Return F (11, 6): what the uncertainties of both centres do to the estimates."""
        first, second = self.centres_mm
        return np.hstack(
            [
                by_centre(lambda centre: self.estimates((centre, second)), self.calibrations[0]),
                by_centre(lambda centre: self.estimates((first, centre)), self.calibrations[1]),
            ]
        )

    def noise_covariance(self) -> Float:
        """Return the covariance (11, 11) of all estimates but for what the centres add."""
        plane, of_plane = Heights.of(self.pairs, self.centres_mm).plane()
        weights = gradient_weights(self.pairs.first.before_mm[self.pairs.chosen])
        by_plane = [
            np.einsum("nip,nis->ps", weights, _by_plane(after_mm, centre_mm, plane))
            for after_mm, centre_mm in zip(self.pairs.positions_mm(), self.centres_mm, strict=True)
        ]
        through_plane = of_plane @ np.vstack([*by_plane, np.eye(3)]).T
        n, total = len(weights), np.zeros((11, 11))
        to_first = np.zeros((len(self.pairs.first.before_mm), 2, 11))
        to_first[self.pairs.chosen] = through_plane
        to_first[self.pairs.chosen, :, :4] += weights
        on_pairs = -through_plane
        on_pairs[:, :, 4:8] += weights
        to_second = (self.pairs.partner.T @ on_pairs.reshape(n, 22)).reshape(-1, 2, 11)
        for points, to_points in ((self.pairs.first, to_first), (self.pairs.second, to_second)):
            total += points.covariance(to_points)
        return total

    def agreed(self) -> tuple["_Both", Float]:
        """Return this with centres for which both cameras see one strain, and the estimates' covariance."""
        noise, current = self.noise_covariance(), self
        factors = [centre_factors(calibration) for calibration in self.calibrations]
        apart = np.hstack([np.eye(4), -np.eye(4), np.zeros((4, 3))])
        certain = np.linalg.inv(apart @ noise @ apart.T + _SYSTEMATIC**2 * np.eye(4))
        shift = np.zeros(6)
        for _ in range(_STEPS):
            by_centres = current.by_centres()
            slopes = apart @ by_centres
            wanted = slopes @ shift - apart @ current.estimates(current.centres_mm)
            left = np.linalg.inv(slopes.T @ certain @ slopes + np.eye(6))
            shift = left @ slopes.T @ certain @ wanted
            first, second = (
                centre + factor @ part
                for centre, factor, part in zip(self.centres_mm, factors, (shift[:3], shift[3:]), strict=True)
            )
            current = _Both(self.pairs, self.calibrations, (first, second))
        # Errors enter directly and through the adjustment, which also leaves some of the centres open.
        gain = by_centres @ left @ slopes.T @ certain
        direct, still_open = np.eye(11) - gain @ apart, by_centres @ left
        total = direct @ noise @ direct.T + still_open @ still_open.T + _SYSTEMATIC**2 * gain @ gain.T
        return current, np.asarray(total)

    def step(self, measurements: tuple[Measurement, Measurement]) -> TwoCameraStep:
        """Return all that the step says."""
        both, covariance = self.agreed()
        heights = Heights.of(both.pairs, both.centres_mm)
        estimates, (plane, _) = both.estimates(both.centres_mm), heights.plane()
        plane_std = np.sqrt(np.diag(covariance)[8:])
        measure, shared = measurements[0].strain_settings.measure, len(both.pairs.chosen)
        corrections = []
        cameras = zip((both.pairs.first, both.pairs.second), both.centres_mm, strict=True)
        for k, (points, centre_mm) in enumerate(cameras):
            at = slice(4 * k, 4 * k + 4)
            mean = strain_of_gradient(estimates[at].reshape(2, 2), covariance[at, at], shared, measure)
            moved = moved_out_of_plane(points.displacement, centre_mm, Plane(), plane)
            corrections.append(Correction("two cameras", mean, moved, Plane(), plane, plane_std))
        certainty = np.array([1.0 / np.trace(covariance[at, at]) for at in (slice(0, 4), slice(4, 8))])
        weigh = np.kron(certainty / certainty.sum(), np.eye(4))
        gradient, errors = weigh @ estimates[:8], weigh @ covariance[:8, :8] @ weigh.T
        mean = strain_of_gradient(gradient.reshape(2, 2), errors, shared, measure)
        return TwoCameraStep((corrections[0], corrections[1]), mean, *both.height_maps(heights))

    def height_maps(self, heights: Heights) -> tuple[Float, Float]:
        """Return heights and their standard deviations (noise alone) on the first camera's grid."""
        first = self.pairs.first
        maps = [np.full(first.use.shape, np.nan) for _ in range(2)]
        rows, columns = (axis[self.pairs.chosen] for axis in np.nonzero(first.use))
        noise_mm = np.hypot(_noise_mm(first), _noise_mm(self.pairs.second))
        maps[0][rows, columns] = heights.z_mm
        maps[1][rows, columns] = noise_mm / np.linalg.norm(heights.parallax, axis=1)
        return maps[0], maps[1]


def _by_plane(after_mm: Float, centre_mm: Float, plane: Plane) -> Float:
    """Return the derivative (n, 2, 3) of positions on the plane by slope x, slope y and shift (mm)."""
    at = np.array([plane.slope_x, plane.slope_y, plane.shift_mm])
    sides = [
        (Plane(*(at + step)).within(after_mm, centre_mm) - Plane(*(at - step)).within(after_mm, centre_mm))
        / (2 * _SMALL)
        for step in _SMALL * np.eye(3)
    ]
    return np.stack(sides, axis=-1)
