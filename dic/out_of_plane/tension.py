"""Tension seen by one camera: each image corrected for the tilt of its specimen since the reference.

`dic.out_of_plane.tilt` separates tilt from strain if the strain is uniform. The residuals of affine motion,
bending and tilt test this: polynomials of second and third degree mean that strain is not uniform, other
residuals that the points are not one body. In both cases the image stays as calibrated.
"""

import numpy as np

from dic.calibration.calibration import Calibration
from dic.out_of_plane.correction import Correction, by_centre, points_of
from dic.out_of_plane.plane import Plane, moved_out_of_plane
from dic.out_of_plane.tilt import TiltFit, fit_tilt, tilt_seen_from
from dic.out_of_plane.uncertainty import Points
from dic.strain.fit import gradient_weights, slopes_of
from dic.strain.measurement import Measurement
from dic.strain.strain import strain_of_gradient
from dic.typing import Float

_FEWEST_POINTS = 30

_MOST_TURN_DEG = 5.0
"""Assumed tilt of the specimen in the reference. The tilt rotates with the specimen within the plane. The
false strain is the tilt times the rotation (rad) and has no projective signature."""

_UNEVEN_PX = 0.002
"""Largest accepted remainder (rms) beyond noise; spline and lens cause that much."""

_TORN = 2.0
"""Largest accepted residuals, as a multiple of what noise explains."""

_BEYOND_NOISE = 3.0
_USEFUL = 100e-6
"""Largest standard deviation of strain of a correction that is not significant."""


def correct_tilt(measurement: Measurement, calibration: Calibration, poisson_ratio: float) -> Correction:
    """Correct one image of a tension test for the tilt of its specimen since the reference.

    Where the method does not apply, the measurement stays as calibrated, with the reason.

    Parameters
    ----------
    measurement : Measurement
        Calibrated.
    calibration : Calibration
        Of the same camera.
    poisson_ratio : float
        Poisson's ratio of the specimen, for the shape of its bending.
    """
    pinhole = calibration.pinhole
    if pinhole is None:
        return Correction.refused("tilt", measurement, "the calibration knows no camera centre")
    points = points_of(measurement, calibration)
    objection = _unsuitable(measurement, points)
    if objection is not None:
        return Correction.refused("tilt", measurement, objection)
    centre_mm, settings = pinhole.centre_mm, measurement.strain_settings
    fit = fit_tilt(points, centre_mm, poisson_ratio)
    objection = _uneven(fit, points, calibration.mm_per_px)
    if objection is not None:
        return Correction.refused("tilt", measurement, objection)
    gradient = _gradient(points, centre_mm, fit.plane)
    change = np.abs(gradient - _gradient(points, centre_mm, Plane())).max()
    covariance = _covariance(points, fit, centre_mm, poisson_ratio)
    std = np.sqrt(np.diag(covariance))
    if std[:4].max() > _USEFUL and change < 2 * std[:4].max():
        reason = f"the tilt is too uncertain here (strain ± {1e6 * std[:4].max():.0f} µε)"
        return Correction.refused("tilt", measurement, reason)
    mean = strain_of_gradient(gradient, covariance[:4, :4], len(points.before_mm), settings.measure)
    moved = moved_out_of_plane(points.displacement, centre_mm, Plane(), fit.plane)
    return Correction("tilt", mean, moved, settings, fit.plane, np.array([*std[4:], np.nan]))


def _covariance(points: Points, fit: TiltFit, centre_mm: Float, poisson_ratio: float) -> Float:
    """Return the covariance (6, 6) of the corrected mean gradient and of both slopes of the plane."""

    def estimate(centre_mm: Float) -> Float:
        found = tilt_seen_from(points, centre_mm, poisson_ratio, fit.plane)
        gradient = _gradient(points, centre_mm, found)
        return np.array([*gradient.ravel(), found.slope_x, found.slope_y])

    weights = gradient_weights(points.before_mm)
    by_slope = np.einsum("nip,nis->ps", weights, fit.by_slope)
    total = np.concatenate([weights + fit.slope_weights @ by_slope.T, fit.slope_weights], axis=2)
    return points.covariance(total, by_centre(estimate, centre_mm))


def _gradient(points: Points, centre_mm: Float, plane: Plane) -> Float:
    """Return the mean displacement gradient (2, 2) of the points, with deformed positions on `plane`."""
    moved = plane.within(points.after_mm, centre_mm) - points.before_mm
    return slopes_of(points.before_mm, moved)


def _unsuitable(measurement: Measurement, points: Points) -> str | None:
    """Return the reason why a tilt cannot be determined from this measurement, or None."""
    mean, n = measurement.calibrated_mean, len(points.before_mm)
    if mean is None or n < _FEWEST_POINTS or not points.determine(2):
        return (
            f"{n} points are too few, or lie on too few rows: "
            f"at least {_FEWEST_POINTS} all over the gauge section are needed"
        )
    if abs(mean.rotation_deg) > _MOST_TURN_DEG:
        return (
            f"the specimen turned by {mean.rotation_deg:.1f}°, more than the {_MOST_TURN_DEG:g}° "
            "up to which tension tells its tilt"
        )
    return None


def _uneven(fit: TiltFit, points: Points, mm_per_px: float) -> str | None:
    """Return the reason why affine motion, bending and tilt do not explain the field, or None."""
    noise = points.displacement.noise
    if noise is None:
        return "the displacements come without their noise"
    covariance = points.covariance(fit.remainder_weights)
    expected = np.sqrt(np.einsum("nip,pq,niq->", fit.terms, covariance, fit.terms) / len(fit.terms))
    limit_mm = _BEYOND_NOISE * expected + _UNEVEN_PX * mm_per_px
    if fit.remainder_rms_mm > limit_mm:
        return (
            "the strain is not uniform (a smooth remainder of "
            f"{fit.remainder_rms_mm / mm_per_px:.3f} px, at most {limit_mm / mm_per_px:.3f} px is explained)"
        )
    rms_mm = np.sqrt((fit.residual_mm**2).sum(axis=1).mean())
    by_noise_mm = np.sqrt((noise.factors[points.use] ** 2).sum(axis=(1, 2)).mean())
    limit_mm = _TORN * by_noise_mm + _UNEVEN_PX * mm_per_px
    if rms_mm > limit_mm:
        return (
            f"the motion is not that of one body (residual {rms_mm / mm_per_px:.3f} px rms, "
            f"at most {limit_mm / mm_per_px:.3f} px is explained)"
        )
    return None
