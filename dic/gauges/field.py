"""The displacement fields of one image that gauges read: raw, calibrated and corrected, with errors."""

from dataclasses import dataclass, field, replace

import numpy as np

from dic.calibration.calibration import Calibration
from dic.gauges.strains import covariance_along
from dic.out_of_plane.correction import Correction
from dic.strain.displacement import Displacement, calibrated_noise
from dic.strain.measurement import Measurement
from dic.strain.strain import MeanStrain
from dic.typing import Float

_STRAINS = ("exx", "eyy", "exy")


@dataclass(frozen=True)
class GaugeField:
    """A displacement field of one kind, with the errors that all points share."""

    displacement: Displacement
    """The displacements. The displacements have the errors that the images cause, if these errors are known.
    """
    common_noise: Float
    """Shape (3, 3). Covariance of errors of exx, eyy, exy that are the same at all points. These errors arise
    because the noise of this image changes the correction.
    """
    shared: Float
    """Shape (3, 3). Covariance of errors of exx, eyy, exy that are the same at all points and have other
    causes: the calibration, and motion out of the grid's plane.
    """
    measure: str
    """The strain measure."""
    mounting: Float = field(default_factory=lambda: np.zeros((3, 0)))
    """Shape (3, causes). The part of `shared` that follows the measured motion; see `Correction.mounting`. No
    causes if it is not known.
    """
    _along: dict[bytes, tuple[float, float]] = field(default_factory=dict, repr=False, compare=False)

    def along(self, weights: Float) -> tuple[float, float]:
        """Return the variances of a strain by `common_noise` and by `shared`; they are kept.

        `weights`, shape (3,): weights of exx, eyy and exy in the strain.
        """
        key = weights.tobytes()
        if key not in self._along:
            self._along[key] = (
                covariance_along(self.common_noise, weights, weights),
                covariance_along(self.shared, weights, weights),
            )
        return self._along[key]


def fields_of(
    measurement: Measurement, correction: Correction | None, calibration: Calibration | None
) -> dict[str, GaugeField]:
    """Return the available fields of an image, keyed by kind: "raw", "calibrated" and "corrected".

    Result files contain no errors of calibrated displacements. The function computes these errors from the
    errors of the displacements in pixels, and from the calibration. The function uses the errors of
    calibrated displacements also for corrected displacements: motion out of the plane changes the image scale
    so little that the change of the errors is below their uncertainty.

    `calibration`: needed for results that were read from a file.
    """
    raw, calibrated = measurement.raw, measurement.calibrated
    measure, none = measurement.strain_settings.measure, np.zeros((3, 3))
    if calibrated is None:
        return {"raw": GaugeField(raw, none, none, measure)}
    if calibrated.noise is None and calibration is not None:
        calibrated = replace(calibrated, noise=calibrated_noise(measurement.field, calibration))
    # As for mean strain, raw values use the same points as calibrated ones.
    raw = replace(raw, valid=raw.valid & calibrated.valid)
    fields = {
        "raw": GaugeField(raw, none, none, measure),
        "calibrated": GaugeField(calibrated, none, _shared(measurement), measure),
    }
    if correction is not None and correction.declined is None and correction.method != "none":
        corrected = replace(correction.displacement, noise=calibrated.noise)
        noise = _common_noise(correction, measurement.by_images)
        mounting = np.zeros((3, 0)) if correction.mounting is None else correction.mounting
        fields["corrected"] = GaugeField(corrected, noise, correction.shared_errors, measure, mounting)
    return fields


def _shared(measurement: Measurement) -> Float:
    """Return the covariance, shape (3, 3), of the calibrated strain's errors that are equal at all points."""
    if measurement.shared is not None:
        return measurement.shared
    whole, own = measurement.calibrated_mean, measurement.by_images
    if whole is None or own is None:
        return np.full((3, 3), np.nan)
    return np.diag(_variances(whole) - _variances(own)).clip(0.0)


def _common_noise(correction: Correction, by_images: MeanStrain | None) -> Float:
    """Return the covariance, shape (3, 3), of strain errors that noise causes through the correction.

    The noise part of the corrected mean strain contains the noise of the field and the noise of the
    correction.
    """
    known = correction.uncertainty or {}
    if by_images is None or "exx_std_images" not in known:
        return np.zeros((3, 3))
    whole = np.array([known[f"{name}_std_images"] ** 2 for name in _STRAINS])
    return np.diag(np.maximum(whole - np.nan_to_num(_variances(by_images)), 0.0))


def _variances(mean: MeanStrain) -> Float:
    return np.array([getattr(mean, f"{name}_std") ** 2 for name in _STRAINS])
