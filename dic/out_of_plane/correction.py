"""The result of a correction for motion out of the grid's plane, for all correction methods."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from dic.calibration.calibration import Calibration, Model
from dic.out_of_plane.plane import Plane, moved_out_of_plane
from dic.out_of_plane.uncertainty import Points
from dic.strain.displacement import NOWHERE, Displacement, calibrated_displacement
from dic.strain.measurement import Measurement
from dic.strain.settings import StrainSettings
from dic.strain.strain import MeanStrain, StrainField, mean_strain, strain_field, with_shared
from dic.typing import Float

_CLEARLY_BETTER = 0.95
"""The bicubic map is used only if its cross-validation error is below this share of the pinhole model's."""

_STEP = 1e-3
"""Step of the camera's centre for numerical derivatives, as a fraction of the camera's distance."""


@dataclass(frozen=True)
class Correction:
    """The strain of one image after correction for motion out of the grid's plane.

    Attributes
    ----------
    method : str
        Method of the correction. "tilt" uses one image of one camera. "rigidity" uses all steps of a rotation
        of a rigid specimen. "alignment" uses an alignment from an earlier rotation. "two cameras" uses both
        cameras. "none" means that no correction was requested.
    mean : MeanStrain
        Corrected mean strain, or the calibrated mean strain if the image was not corrected.
    displacement : Displacement
        Displacement within the specimen's plane, or the calibrated displacement if the image was not
        corrected.
    strain_settings : StrainSettings
        Settings of local strain.
    after : Plane or None
        Plane of the specimen's surface in this image. None if the plane was not measured.
    after_std : ndarray, shape (3,), or None
        Standard deviations of slope x, slope y and shift (mm) of `after`. NaN for values that were not
        measured.
    declined : str or None
        The reason why there is no correction, or None if the image was corrected.
    stored_strain : StrainField or None
        Local strain that was read from a result file. If the attribute is None, `strain` is computed at its
        first use.
    uncertainty : mapping of str to float, or None
        Parts of the standard deviations of `mean`, and probabilities of causes, by their names in JSON; see
        `docs/results.md`. None if not known.
    shared : ndarray, shape (3, 3), or None
        Covariance of the errors of exx, eyy, exy that all points share: all errors except the noise and
        interpolation errors of the images. If the attribute is None, `shared_errors` derives it from `mean`.
    mounting : ndarray, shape (3, 3), or None
        Errors of exx, eyy, exy (rows) if slope x, slope y or the distance of the specimen's surface in the
        reference (columns) differs by one standard deviation from the grid's plane. These errors are part of
        `shared`. The mounting is the same in all images of a test, so each error follows the measured motion.
        None if the method has no such error, or if the image was not corrected.
    """

    method: str
    mean: MeanStrain
    displacement: Displacement
    strain_settings: StrainSettings
    after: Plane | None = None
    after_std: Float | None = None
    declined: str | None = None
    stored_strain: StrainField | None = None
    uncertainty: Mapping[str, float] | None = None
    shared: Float | None = None
    mounting: Float | None = None

    def __repr__(self) -> str:
        what = f"{self.mean}" if self.declined is None else f"declined: {self.declined}"
        return f"Correction({self.method}, {what})"

    @classmethod
    def refused(
        cls,
        method: str,
        measurement: Measurement,
        reason: str,
        mean: MeanStrain | None = None,
        uncertainty: Mapping[str, float] | None = None,
        shared: Float | None = None,
    ) -> "Correction":
        """Return the result for a measurement that cannot be corrected: its calibrated values and the reason.

        The argument `mean` is the calibrated mean strain; its standard deviations contain the motion out of
        the plane. The argument `uncertainty` gives the parts of these standard deviations, and `shared` is
        the covariance of the errors that all points share. Without these arguments the standard deviations
        are not known.
        """
        if measurement.calibrated is None or measurement.calibrated_mean is None:
            raise ValueError("only calibrated measurements can be corrected")
        if shared is None:
            shared = np.full((3, 3), np.nan)
        return cls(
            method,
            mean or with_shared(measurement.calibrated_mean, shared),
            measurement.calibrated,
            measurement.strain_settings,
            declined=reason,
            stored_strain=measurement.stored_strain,
            uncertainty=uncertainty,
            shared=shared,
        )

    @cached_property
    def strain(self) -> StrainField:
        """Local strain, computed from `displacement` or read from a result file."""
        if self.stored_strain is not None:
            return self.stored_strain
        return with_shared(strain_field(self.displacement, self.strain_settings), self.shared_errors)

    @property
    def shared_errors(self) -> Float:
        """Covariance of the errors of exx, eyy, exy that all points share, shape (3, 3)."""
        if self.shared is not None:
            return self.shared
        by_images = mean_strain(self.displacement, measure=self.strain_settings.measure)
        return np.diag(
            [
                max(getattr(self.mean, name) ** 2 - np.nan_to_num(getattr(by_images, name)) ** 2, 0.0)
                for name in ("exx_std", "eyy_std", "exy_std")
            ]
        )

    def outline(self) -> "Correction":
        """Return the correction without displacements and local strains, which take most of the memory."""
        nothing = replace(NOWHERE, unit=self.displacement.unit)
        return replace(self, displacement=nothing, stored_strain=None)

    def as_dict(self) -> dict[str, Any]:
        """Return the corrected strain and the plane as a dictionary for JSON; see `docs/results.md`."""
        summary = self.mean.as_dict() | {
            "applied": self.declined is None,
            "method": self.method,
            "reason": self.declined,
        }
        slopes: dict[str, float | None] = {}
        if self.after is not None and self.after_std is not None:
            values = [self.after.slope_x, self.after.slope_y]
            degrees = [np.degrees(np.arctan(values)), np.degrees(self.after_std[:2])]
            names = ("slope_x_deg", "slope_y_deg", "slope_x_deg_std", "slope_y_deg_std")
            slopes = dict(zip(names, map(_plain, np.concatenate(degrees)), strict=True))
            slopes["shift_mm"] = _plain(self.after.shift_mm) if np.isfinite(self.after_std[2]) else None
            slopes["shift_mm_std"] = _plain(self.after_std[2])
        return summary | slopes | dict(self.uncertainty or {})


def stated(measurement: Measurement, correction: Correction) -> Measurement:
    """Return the measurement; the standard deviations of its calibrated strain contain motion out of the
    plane.

    If the strain was corrected, the size of the correction counts as the error of the calibrated strain.
    Otherwise the error follows from the motion that is expected of a specimen.
    """
    calibrated, found = measurement.calibrated_mean, correction.mean
    if calibrated is None:
        raise ValueError("only calibrated measurements can be corrected")
    off = np.array([calibrated.exx - found.exx, calibrated.eyy - found.eyy, calibrated.exy - found.exy])
    return measurement.sharing(correction.shared_errors + np.outer(off, off))


def points_of(
    measurement: Measurement,
    calibration: Calibration,
    surface: Plane | None = None,
    centre_mm: Float | None = None,
) -> Points:
    """Return the points of a measurement inside the calibrated area, mapped by the better calibration model.

    The pinhole model is used unless the bicubic map is clearly better. The maps of the two models differ by
    up to 0.01 px, which matters if points move far. The corrections also use the camera's centre. The centre
    comes from the pinhole model and is consistent only with the map of the pinhole model.

    The argument `surface` is the plane of the specimen's surface in the reference; displacements are along
    this plane. The argument `centre_mm` is the camera's centre, if the centre is known better than from the
    calibration.
    """
    best, field = correcting(calibration), measurement.field
    gradients = measurement.strain_settings.source == "shape"
    displacement = calibrated_displacement(field, best, gradients=gradients)
    use = displacement.valid
    before = field.points.reshape(*use.shape, 2)[use]
    moved = np.stack([field.u_px, field.v_px], axis=-1)[use]
    points = Points(displacement, use, np.stack([before, before + moved]), best, still=measurement.still)
    if surface is None or calibration.pinhole is None:
        return points
    points = replace(points, surface=surface, seen_from_mm=centre_mm)
    on_surface = moved_out_of_plane(displacement, points.grid_centre_mm, surface, surface)
    return replace(points, displacement=on_surface)


def correcting(calibration: Calibration) -> Calibration:
    """Return the calibration with the model in use that corrections use; see `points_of`."""
    if calibration.pinhole is None:
        return calibration.using("bicubic")
    limit_px = _CLEARLY_BETTER * calibration.pinhole.cross_validation_px
    model: Model = "bicubic" if calibration.bicubic_cross_validation_px < limit_px else "pinhole"
    return calibration.using(model)


def by_centre(estimate: Callable[[Float], Float], centre_mm: Float) -> Float:
    """Return the changes (p, 3) of estimates (p,) per mm of change of the camera's centre (X, Y, Z)."""
    step = _STEP * centre_mm[2]
    columns = []
    for shift in step * np.eye(3):
        ahead, behind = (estimate(centre_mm + sign * shift) for sign in (1, -1))
        columns.append((ahead - behind) / (2 * step))
    return np.stack(columns, axis=-1)


def _plain(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
