"""All that one image says: its field, raw and calibrated displacements, and their strains."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

from dic.calibration.calibration import Calibration
from dic.correlation.field import Field
from dic.correlation.settings import CorrelationSettings
from dic.correlation.status import Status
from dic.strain.displacement import Displacement, calibrated_displacement, raw_displacement
from dic.strain.strain import MeanStrain, StrainField, StrainSettings, mean_strain, strain_field

_POINTS_OF_A_PLANE = 3


@dataclass(frozen=True)
class Measurement:
    """One deformed image, measured against its reference.

    Attributes
    ----------
    label : str
        The image's file, or the step of its run.
    field : Field
    settings : CorrelationSettings
        How the field was correlated.
    raw : Displacement
        In pixels.
    calibrated : Displacement or None
        In millimetres, when there is a calibration.
    strain_settings : StrainSettings
        Which strain, and from what.
    gauge_px : int
        Width of the virtual strain gauge: of the pixels that a local strain comes from.
    gauge_mm : float or None
        The same on the specimen, in the middle of the grid, when there is a calibration.
    """

    label: str
    field: Field
    settings: CorrelationSettings
    raw: Displacement
    calibrated: Displacement | None
    strain_settings: StrainSettings
    gauge_px: int
    gauge_mm: float | None

    @cached_property
    def raw_mean(self) -> MeanStrain:
        """Mean strain of the displacements in pixels, from the points that `calibrated_mean` uses too."""
        valid = None if self.calibrated is None else self.calibrated.valid
        return mean_strain(self.raw, valid, self.strain_settings.measure)

    @cached_property
    def calibrated_mean(self) -> MeanStrain | None:
        """Mean strain of the calibrated displacements."""
        if self.calibrated is None:
            return None
        return mean_strain(self.calibrated, measure=self.strain_settings.measure)

    @cached_property
    def strain(self) -> StrainField:
        """Local strain, calibrated if there is a calibration, raw otherwise."""
        return strain_field(self.calibrated or self.raw, self.strain_settings)

    @property
    def good(self) -> bool:
        """Whether at least half of the points in view have a value and the mean strain exists."""
        return self.objection is None

    @property
    def objection(self) -> str | None:
        """What is not good about the measurement, or None."""
        if 2 * self.field.count(Status.CONVERGED) < self.field.in_view:
            return "fewer than half of the points in view converged; see their statuses"
        if self.raw_mean.points < _POINTS_OF_A_PLANE:
            where = "" if self.calibrated is None else " within the calibrated area"
            return f"fewer than {_POINTS_OF_A_PLANE} points converged{where}: too few for a mean strain"
        return None

    def summary(self) -> dict[str, Any]:
        """Return the figures that programs read, JSON-ready: see `docs/results.md`."""
        field = self.field
        failures = {s.text: field.count(s) for s in Status if s is not Status.CONVERGED and field.count(s)}
        summary: dict[str, Any] = {
            "file": self.label,
            "points": field.in_view,
            "converged": field.count(Status.CONVERGED),
            "out_of_view": field.count(Status.OUT_OF_VIEW),
            "failures": failures,
            "start": field.start,
            "updates": field.updates,
            "strain": vars(self.strain_settings) | {"gauge_px": self.gauge_px, "gauge_mm": self.gauge_mm},
            "raw": self.raw_mean.as_dict(),
        }
        if self.calibrated_mean is not None:
            summary["calibrated"] = self.calibrated_mean.as_dict()
        return summary


def measure(
    label: str,
    field: Field,
    calibration: Calibration | None = None,
    settings: CorrelationSettings | None = None,
    strain: StrainSettings | None = None,
) -> Measurement:
    """Return the measurement of a correlated image.

    Parameters
    ----------
    label : str
    field : Field
    calibration : Calibration, optional
    settings : CorrelationSettings, optional
        How the field was correlated.
    strain : StrainSettings, optional
    """
    settings, strain = settings or CorrelationSettings(), strain or StrainSettings()
    gauge_px = strain.gauge_px(settings)
    calibrated, gauge_mm = None, None
    if calibration is not None:
        calibrated = calibrated_displacement(field, calibration, settings)
        gauge_mm = gauge_px * calibration.mm_per_px
    raw = raw_displacement(field, settings)
    return Measurement(label, field, settings, raw, calibrated, strain, gauge_px, gauge_mm)
