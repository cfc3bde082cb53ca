"""Correct images of a tension test by one camera for the specimen's motion out of the grid's plane.

`dic.out_of_plane.tilt` separates the motion out of the plane from strain. The calibrated strain is not
corrected if the models of the motion do not explain the displacements, or if the result would be less certain
than the calibrated strain. The standard deviation of the calibrated strain then contains the expected motion
out of the plane.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from dic.calibration.calibration import Calibration
from dic.out_of_plane.causes import curved
from dic.out_of_plane.correction import Correction, points_of
from dic.out_of_plane.plane import Plane, moved_out_of_plane
from dic.out_of_plane.polynomial import Polynomial
from dic.out_of_plane.reasons import turned_camera_reason, uncertain_mounting, uneven_reason
from dic.out_of_plane.recession import covering_contraction, with_travel, without_thinning
from dic.out_of_plane.shift import Shift
from dic.out_of_plane.strain_parts import StrainParts, open_parts
from dic.out_of_plane.tilt import TiltFit, fit_tilt, suspect
from dic.out_of_plane.uncertainty import Points
from dic.strain.displacement import Displacement
from dic.strain.fit import gradient_weights, slopes_of
from dic.strain.measurement import Measurement
from dic.strain.strain import MeanStrain, strain_of_gradient, with_shared
from dic.strain.tensor import strain_by_gradient, strain_covariance
from dic.typing import Float

_FEWEST_POINTS = 30

_MOST_TURN_DEG = 5.0
"""Largest rotation of the specimen within the grid's plane for which the tilt is corrected.

If the specimen is already tilted in the reference, this tilt rotates with the specimen. The rotation causes a
false strain of tilt times rotation (rad), which this method cannot detect.
"""

_UNEXPLAINED = 70.0
"""Largest misfit of a field that the model explains. Noise alone exceeds it once in a billion fields."""

_UNEVEN_PX = 0.002
_TORN = 2.0
"""Largest accepted residuals, as a multiple of the residuals that noise causes."""

_LARGEST_PART = 0.5
"""The mounting is named as the reason for a refusal if its share of the variance is above this limit."""

_USEFUL = 100e-6
"""If the strain's standard deviation is larger than this, only a significant correction is applied."""


def correct_tilt(
    measurement: Measurement,
    calibration: Calibration,
    poisson_ratio: float,
    shift: Shift | None = None,
) -> Correction:
    """Correct one image of a tension test for motion of the specimen out of the plane since the reference.

    If the image cannot be corrected, the result keeps the calibrated strain and gives the reason.

    `measurement`: the calibrated measurement of the image. `calibration`: calibration of the camera.
    `poisson_ratio`: Poisson's ratio of the specimen. `shift`: knowledge about the specimen's shift towards
    the camera since the reference. Default: the expected shift, without a hinge.
    """
    shift = shift or Shift.of(None, None)
    pinhole = calibration.pinhole
    if pinhole is None:
        return Correction.refused("tilt", measurement, "the calibration knows no camera centre")
    points = points_of(measurement, calibration)
    objection = _unsuitable(measurement, points)
    if objection is not None:
        return declined("tilt", measurement, calibration, objection, shift, poisson_ratio, points)
    polynomial = Polynomial.of(points, pinhole.centre_mm)
    fit = fit_tilt(polynomial, poisson_ratio, shift)
    local = _unexplained(fit, points, calibration.mm_per_px)
    if local is not None:
        suspicion = suspect(polynomial, poisson_ratio, shift)
        half_width_mm = float(np.abs(points.before_mm - points.before_mm.mean(axis=0)).max())
        reason = uneven_reason(fit.misfit, _UNEXPLAINED, suspicion, half_width_mm, local)
        return declined("tilt", measurement, calibration, reason, shift, poisson_ratio, points)
    fit = with_travel(fit, shift, points)
    fit, numbers = without_thinning(fit, shift, poisson_ratio, pinhole.centre_mm)
    height_mm = float(fit.plane.to_axes(pinhole.centre_mm)[2])
    parts, shown = covering_contraction(fit.gradient, fit.parts, poisson_ratio, height_mm)
    return _corrected(measurement, points, replace(fit, parts=parts), pinhole.centre_mm, numbers | shown)


def declined(
    method: str,
    measurement: Measurement,
    calibration: Calibration,
    reason: str,
    shift: Shift,
    poisson_ratio: float | None = None,
    points: Points | None = None,
) -> Correction:
    """Return the calibrated strain with the reason why it is not corrected.

    The standard deviations contain the expected motion of a specimen out of the plane. The argument
    `poisson_ratio` is that of a specimen in tension; None for another motion. `points`: the points of the
    measurement, if they are known.
    """
    pinhole = calibration.pinhole
    if points is None and pinhole is not None:
        points = points_of(measurement, calibration)
    if pinhole is None or points is None or not points.determine(1) or points.displacement.noise is None:
        return Correction.refused(method, measurement, reason)
    measure = measurement.strain_settings.measure
    gradient, covariances = open_parts(points, shift)
    numbers: dict[str, float] = {}
    if poisson_ratio is not None:
        height_mm = float(pinhole.centre_mm[2])
        covariances, numbers = covering_contraction(gradient, covariances, poisson_ratio, height_mm)
    parts = StrainParts.of(gradient, covariances, measure)
    mean = _calibrated_mean(measurement, np.sum(list(covariances.values()), axis=0))
    return Correction.refused(method, measurement, reason, mean, parts.as_dict() | numbers, parts.shared)


def with_still(found: Correction, measurement: Measurement, calibration: Calibration) -> Correction:
    """Return a correction by another method, whose errors also contain those that still images show."""
    if measurement.still is None:
        return found
    points = points_of(measurement, calibration)
    covariance = points.still_covariance(gradient_weights(points.before_mm))
    shared = strain_covariance(points.mean_gradient, covariance, measurement.strain_settings.measure)
    # Strains that are read from a file contain the other errors only.
    return replace(
        found, mean=with_shared(found.mean, shared), shared=found.shared_errors + shared, stored_strain=None
    )


def _calibrated_mean(measurement: Measurement, covariance: Float) -> MeanStrain:
    """Return the calibrated mean strain with the given covariance (4, 4) of its gradient."""
    displacement, mean = measurement.calibrated, measurement.calibrated_mean
    if displacement is None or mean is None:
        raise ValueError("only calibrated measurements can be corrected")
    before = displacement.position[displacement.valid]
    gradient = slopes_of(before, displacement.vector[displacement.valid])
    uncertain = strain_of_gradient(gradient, covariance, len(before), measurement.strain_settings.measure)
    return replace(mean, **{name: value for name, value in vars(uncertain).items() if name.endswith("_std")})


def _corrected(
    measurement: Measurement, points: Points, fit: TiltFit, centre_mm: Float, shifts: Mapping[str, float]
) -> Correction:
    settings, count = measurement.strain_settings, len(points.before_mm)
    mean = strain_of_gradient(fit.gradient, fit.covariance, count, settings.measure)
    plain = points.mean_gradient
    calibrated = strain_of_gradient(plain, None, count, settings.measure)
    off = np.array([calibrated.exx - mean.exx, calibrated.eyy - mean.eyy, calibrated.exy - mean.exy])
    parts = StrainParts.of(fit.gradient, fit.parts, settings.measure)
    numbers = {"curved_probability": fit.curved, "graded_probability": fit.graded}
    numbers = parts.as_dict() | dict(shifts) | numbers
    reason = _too_uncertain(parts, float(np.abs(off).max()), points, fit, centre_mm)
    reason = reason or turned_camera_reason(points, fit.slopes, centre_mm)
    if reason is not None:
        covariance = fit.covariance + np.outer((plain - fit.gradient).ravel(), (plain - fit.gradient).ravel())
        mean, shared = _calibrated_mean(measurement, covariance), parts.shared + np.outer(off, off)
        return Correction.refused("tilt", measurement, reason, mean, numbers, shared)
    moved = _flattened(points, fit, centre_mm)
    return Correction(
        "tilt",
        mean,
        moved,
        settings,
        fit.plane,
        fit.plane_std,
        uncertainty=numbers,
        shared=parts.shared,
        mounting=strain_by_gradient(fit.gradient, settings.measure) @ fit.mounting,
    )


def _too_uncertain(
    parts: StrainParts, change: float, points: Points, fit: TiltFit, centre_mm: Float
) -> str | None:
    """Return the reason if a correction by `change` is more likely to harm than to help; otherwise None."""
    # The errors that the shift towards the camera and the camera itself cause are nearly equal in calibrated
    # and in corrected strain, so they are left out of the comparison.
    own_std = np.sqrt(sum(part**2 for name, part in parts.parts.items() if name not in ("shift", "still")))
    if own_std.max() <= _USEFUL or change >= 2 * own_std.max():
        return None
    mounting = (parts.parts["mounting"].max() / own_std.max()) ** 2 > _LARGEST_PART
    doubt = uncertain_mounting(points, centre_mm) if mounting else _doubt(fit)
    return (
        "the tilt is too uncertain here: a correction would change the strain by "
        f"{1e6 * change:.0f} ± {1e6 * own_std.max():.0f} µε{doubt}"
    )


def _doubt(fit: TiltFit) -> str:
    """Return a text about a cause that the images cannot distinguish from a tilt; "" without such a cause."""
    if max(fit.graded, fit.curved) < 0.5:
        return ""
    if fit.graded > fit.curved:
        return ", because a strain gradient along the specimen looks like a tilt"
    return ", because a specimen that bends out of its plane looks like a tilted one"


def _flattened(points: Points, fit: TiltFit, centre_mm: Float) -> Displacement:
    """Return the displacements within the specimen's surface, without tilt and curvature."""
    moved = moved_out_of_plane(points.displacement, centre_mm, Plane(), fit.plane)
    vector = moved.vector.copy()
    vector[points.use] -= curved(points.after_mm, centre_mm, fit.plane, fit.curvatures)
    return replace(moved, vector=vector)


def _unsuitable(measurement: Measurement, points: Points) -> str | None:
    """Return the reason why a tilt cannot be determined from the measurement, or None if it can."""
    mean, n = measurement.calibrated_mean, len(points.before_mm)
    if mean is None or n < _FEWEST_POINTS or not points.determine(3):
        return (
            f"{n} points are too few, or lie on too few rows: "
            f"at least {_FEWEST_POINTS} all over the gauge section are needed"
        )
    if points.displacement.noise is None:
        return "the noise of the displacements is unknown"
    if abs(mean.rotation_deg) > _MOST_TURN_DEG:
        return (
            f"the specimen turned by {mean.rotation_deg:.1f}°, more than the {_MOST_TURN_DEG:g}° "
            "up to which the tilt can be measured"
        )
    return None


def _unexplained(fit: TiltFit, points: Points, mm_per_px: float) -> str | None:
    """Return a text about residuals that are larger than noise; None if the models explain the field.

    If the residuals are not larger than noise, but the models do not explain the field, the text is empty.
    """
    noise = points.displacement.noise
    if noise is None:
        raise ValueError("the noise of these displacements is unknown")
    rms_mm = np.sqrt((fit.residual_mm**2).sum(axis=1).mean())
    by_noise_mm = np.sqrt((noise.factors[points.use] ** 2).sum(axis=(1, 2)).mean())
    still_mm = 0.0 if points.still is None else points.still.rest_mm
    limit_mm = _TORN * np.hypot(by_noise_mm, still_mm) + _UNEVEN_PX * mm_per_px
    if rms_mm > limit_mm:
        return f"residual {rms_mm / mm_per_px:.3f} px rms, at most {limit_mm / mm_per_px:.3f} px is explained"
    return "" if fit.misfit > _UNEXPLAINED else None
