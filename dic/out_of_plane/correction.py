"""The result of a correction for motion out of the grid's plane, by any method."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from dic.calibration.calibration import Calibration, Model
from dic.out_of_plane.plane import Plane
from dic.out_of_plane.uncertainty import Points
from dic.strain.displacement import Displacement, calibrated_displacement
from dic.strain.measurement import Measurement
from dic.strain.strain import MeanStrain, StrainField, StrainSettings, strain_field
from dic.typing import Float

_CLEARLY_BETTER = 0.95
"""The bicubic map is used only if its cross-validation error is below this fraction of the pinhole's."""

_STEP = 1e-3
"""Step for numerical derivatives by the camera's centre, as a fraction of the camera's distance."""


@dataclass(frozen=True)
class Correction:
    """The strain of one image without the false strain of its motion out of the grid's plane.

    Attributes
    ----------
    method : str
        "tilt" (one camera, by the projective signature), "rigidity" (one camera, all steps of a rotation),
        "alignment" (one camera, by an alignment solved before) or "two cameras"; "none" if no correction was
        requested.
    mean : MeanStrain
        Corrected mean strain; as calibrated where the correction was declined.
    displacement : Displacement
        Displacement within the specimen's plane; as calibrated where the correction was declined.
    strain_settings : StrainSettings
        Settings of local strain.
    after : Plane or None
        Plane of the surface in this image.
    after_std : ndarray, shape (3,), or None
        Standard deviations of slope x, slope y and shift (mm) of `after`; NaN for unmeasured values.
    declined : str or None
        Why no correction was made; None if it was.
    stored_strain : StrainField or None
        Local strain read from a result file. If None, `strain` is computed at its first use.
    """

    method: str
    mean: MeanStrain
    displacement: Displacement
    strain_settings: StrainSettings
    after: Plane | None = None
    after_std: Float | None = None
    declined: str | None = None
    stored_strain: StrainField | None = None

    def __repr__(self) -> str:
        what = f"{self.mean}" if self.declined is None else f"declined: {self.declined}"
        return f"Correction({self.method}, {what})"

    @classmethod
    def refused(cls, method: str, measurement: Measurement, reason: str) -> "Correction":
        """Return the correction of a measurement that stays as calibrated, with the reason."""
        if measurement.calibrated is None or measurement.calibrated_mean is None:
            raise ValueError("only calibrated measurements can be corrected")
        return cls(
            method,
            measurement.calibrated_mean,
            measurement.calibrated,
            measurement.strain_settings,
            declined=reason,
            stored_strain=measurement.stored_strain,
        )

    @cached_property
    def strain(self) -> StrainField:
        """Local strain of the displacement."""
        return self.stored_strain or strain_field(self.displacement, self.strain_settings)

    def as_dict(self) -> dict[str, Any]:
        """Return the values as JSON-ready data: see `docs/results.md`."""
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
        return summary | slopes


def points_of(measurement: Measurement, calibration: Calibration) -> Points:
    """Return the valid points of a measurement, mapped by the pinhole unless bicubic is clearly better.

    The two maps differ by up to 0.01 px, which matters where points move far. Only the map of the pinhole
    model is consistent with the camera centre of that model.
    """
    best, field = calibration.using(_mapped_by(calibration)), measurement.field
    displacement = calibrated_displacement(field, best)
    use = displacement.valid
    before = field.points.reshape(*use.shape, 2)[use]
    moved = np.stack([field.u_px, field.v_px], axis=-1)[use]
    return Points(displacement, use, np.stack([before, before + moved]), best)


def _mapped_by(calibration: Calibration) -> Model:
    if calibration.pinhole is None:
        return "bicubic"
    limit_px = _CLEARLY_BETTER * calibration.pinhole.cross_validation_px
    return "bicubic" if calibration.bicubic_cross_validation_px < limit_px else "pinhole"


def by_centre(estimate: Callable[[Float], Float], centre_mm: Float) -> Float:
    """Return the derivative (p, 3), per mm, of an estimate (p,) by the camera's centre."""
    step = _STEP * centre_mm[2]
    columns = []
    for shift in step * np.eye(3):
        ahead, behind = (estimate(centre_mm + sign * shift) for sign in (1, -1))
        columns.append((ahead - behind) / (2 * step))
    return np.stack(columns, axis=-1)


def _plain(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
