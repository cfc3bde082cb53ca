"""Correct images of a tension test by one camera for the specimen's tilt since the reference image.

`dic.out_of_plane.tilt` separates tilt from strain if the strain is uniform. To test this assumption, a motion
that consists of affine motion, bending and tilt is fitted to the displacements. Residuals that are
polynomials of second and third degree mean that the strain is not uniform. Other large residuals mean that
the points do not belong to one body. If the strain is not uniform, or if the points do not belong to one
body, the calibrated strain is not corrected.
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
"""Largest rotation of the specimen within the grid's plane for which the tilt is corrected.

If the specimen is already tilted in the reference, this tilt rotates with the specimen. The rotation causes a
false strain of tilt times rotation (rad), which this method cannot detect.
"""

_UNEVEN_PX = 0.002
"""Accepted rms of the smooth residuals in addition to noise, because spline and lens cause such residuals."""

_TORN = 2.0
"""Largest accepted residuals, as a multiple of the residuals that noise causes."""

_BEYOND_NOISE = 3.0
_USEFUL = 100e-6
"""A correction with a larger standard deviation of strain is made only if the correction is significant."""


def correct_tilt(measurement: Measurement, calibration: Calibration, poisson_ratio: float) -> Correction:
    """Correct one image of a tension test for the tilt of the specimen since the reference.

    If the image cannot be corrected, the result keeps the calibrated strain and gives the reason.

    Parameters
    ----------
    measurement : Measurement
        The calibrated measurement of the image.
    calibration : Calibration
        Calibration of the camera.
    poisson_ratio : float
        Poisson's ratio of the specimen, which determines the shape of a bent specimen.
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
    """Return the covariance matrix (6, 6) of the corrected mean gradient and of the plane's two slopes."""

    def estimate(centre_mm: Float) -> Float:
        found = tilt_seen_from(points, centre_mm, poisson_ratio, fit.plane)
        gradient = _gradient(points, centre_mm, found)
        return np.array([*gradient.ravel(), found.slope_x, found.slope_y])

    weights = gradient_weights(points.before_mm)
    by_slope = np.einsum("nip,nis->ps", weights, fit.by_slope)
    total = np.concatenate([weights + fit.slope_weights @ by_slope.T, fit.slope_weights], axis=2)
    return points.covariance(total, by_centre(estimate, centre_mm))


def _gradient(points: Points, centre_mm: Float, plane: Plane) -> Float:
    """Return the mean displacement gradient (2, 2) of points whose deformed positions lie on `plane`."""
    moved = plane.within(points.after_mm, centre_mm) - points.before_mm
    return slopes_of(points.before_mm, moved)


def _unsuitable(measurement: Measurement, points: Points) -> str | None:
    """Return the reason why a tilt cannot be determined from the measurement, or None if it can."""
    mean, n = measurement.calibrated_mean, len(points.before_mm)
    if mean is None or n < _FEWEST_POINTS or not points.determine(2):
        return (
            f"{n} points are too few, or lie on too few rows: "
            f"at least {_FEWEST_POINTS} all over the gauge section are needed"
        )
    if abs(mean.rotation_deg) > _MOST_TURN_DEG:
        return (
            f"the specimen turned by {mean.rotation_deg:.1f}°, more than the {_MOST_TURN_DEG:g}° "
            "up to which the tilt can be measured"
        )
    return None


def _uneven(fit: TiltFit, points: Points, mm_per_px: float) -> str | None:
    """Return the reason why the fit of affine motion, bending and tilt is too bad, or None if it is good."""
    noise = points.displacement.noise
    if noise is None:
        return "the noise of the displacements is unknown"
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
