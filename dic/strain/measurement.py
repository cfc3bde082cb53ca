"""The measurement of one image: the result of the correlation, the displacements and the strains."""

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dic.calibration.calibration import Calibration
from dic.correlation.field import Field
from dic.correlation.settings import CorrelationSettings
from dic.correlation.status import Status
from dic.errors import require_kind
from dic.strain.displacement import Displacement, calibrated_displacement, raw_displacement
from dic.strain.remarks import remarks_on
from dic.strain.resolution import Filters, amplitude_kept, amplitude_lost, strain_resolution_px
from dic.strain.settings import StrainSettings
from dic.strain.still import StillErrors
from dic.strain.strain import (
    IMAGES_KEYS,
    MeanStrain,
    StrainField,
    bias_of_mean,
    mean_strain,
    mean_strain_and_bias,
    strain_field,
    with_shared,
)
from dic.typing import Float

_POINTS_OF_A_PLANE = 3
STRAIN_REASONS = ("", "too few neighbours", "outside the calibration", "no displacement")
"""Reasons why a point has no local strain; "" for a point that has one."""


@dataclass(frozen=True)
class Measurement:
    """The displacements and strains of one image relative to its reference image.

    Attributes
    ----------
    label : str
        The path of the image file, or the run's step to which the image belongs.
    field : Field
        The result of the correlation.
    raw : Displacement
        Displacement in pixels.
    calibrated : Displacement or None
        Displacement in millimetres; None if there is no calibration.
    strain_settings : StrainSettings
        Settings with which the strain is computed.
    gauge_px : int
        Width of the virtual strain gauge, which is the area of pixels that determines one local strain.
    gauge_mm : float or None
        Width of the virtual strain gauge on the specimen, for the image scale in the middle of the
        calibration grid; None if there is no calibration. If the camera is off-axis, the widths along x and y
        differ; `gauge_mm` is then the width of a square of the same area.
    raw_mean : MeanStrain
        Mean strain from the displacements in pixels. If there is a calibration, `raw_mean` and
        `calibrated_mean` use the same points.
    calibrated_mean : MeanStrain or None
        Mean strain from the calibrated displacements; None if there is no calibration.
    stored_strain : StrainField or None
        Local strain that was read from a result file. If the attribute is None, `strain` computes the local
        strain at its first use.
    by_images : MeanStrain or None
        The mean calibrated strain with the standard deviations that the images alone cause. None if all parts
        of the standard deviations of `calibrated_mean` come from the images.
    shared : ndarray, shape (3, 3), or None
        Covariance of the errors of exx, eyy, exy that all points of the calibrated strain share: the errors
        of the calibration and of motion out of the grid's plane. None if these errors are not known yet.
    digest : str
        SHA-256 of the image's file or frames; "" if it is not known.
    raw_bias : MeanStrain or None
        `raw_mean` with standard deviations that contain the interpolation bias alone. If the attribute is
        None, `summary` computes them.
    still : StillErrors or None
        Errors of the displacements that still images show, at the time of the image; None if not known.
    """

    label: str
    field: Field
    raw: Displacement
    calibrated: Displacement | None
    strain_settings: StrainSettings
    gauge_px: int
    gauge_mm: float | None
    raw_mean: MeanStrain
    calibrated_mean: MeanStrain | None
    stored_strain: StrainField | None = None
    by_images: MeanStrain | None = None
    shared: Float | None = None
    digest: str = ""
    raw_bias: MeanStrain | None = None
    still: StillErrors | None = None

    def __repr__(self) -> str:
        return f"Measurement({self.label!r}, {self.field}, {self.mean})"

    @property
    def settings(self) -> CorrelationSettings:
        """The settings of the correlation."""
        return self.field.settings

    @property
    def mean(self) -> MeanStrain:
        """Mean strain, calibrated if there is a calibration, raw otherwise."""
        return self.calibrated_mean or self.raw_mean

    @cached_property
    def strain(self) -> StrainField:
        """Local strain, calibrated if there is a calibration, raw otherwise."""
        if self.stored_strain is not None:
            return self.stored_strain
        strain = strain_field(self.calibrated or self.raw, self.strain_settings)
        return strain if self.shared is None else with_shared(strain, self.shared)

    def raw_strain(self, measure: str | None = None) -> StrainField:
        """Return the local strain from displacements in pixels, also if there is a calibration.

        Parameters
        ----------
        measure : str, optional
            Strain measure. Default: that of `strain_settings`.
        """
        settings = replace(self.strain_settings, measure=measure or self.strain_settings.measure)
        if self.calibrated is None and settings == self.strain_settings:
            return self.strain
        return strain_field(self.raw, settings)

    def sharing(self, covariance: Float) -> "Measurement":
        """Return the measurement with standard deviations of calibrated strain that contain shared errors.

        The argument `covariance` is the value of the attribute `shared`; NaN if the errors are not known.
        """
        own = self.by_images or self.calibrated_mean
        if own is None:
            raise ValueError("only calibrated measurements have errors of the calibration")
        return replace(self, calibrated_mean=with_shared(own, covariance), by_images=own, shared=covariance)

    @property
    def resolution_px(self) -> float:
        """Period, px, of the strain wave that keeps 90 % of its amplitude in the local strain."""
        return strain_resolution_px(self.settings, self.strain_settings)

    @cached_property
    def amplitude_kept(self) -> dict[str, Float]:
        """The share of their amplitude that "exx" and "eyy" keep in the local strain, shape (rows, columns).

        The share is estimated from the strain around each point. The share is NaN where the strain cannot be
        distinguished from its noise. `dic.strain.resolution` describes the method.
        """
        filters, strain = Filters(self.settings, self.strain_settings), self.strain
        # An error that all points share does not change the shape of the strain field. So leave it out of the
        # noise.
        noise_xx, noise_yy = (
            std if images is None else images
            for std, images in (
                (strain.exx_std, strain.exx_std_images),
                (strain.eyy_std, strain.eyy_std_images),
            )
        )
        return {
            "exx": amplitude_kept(strain.exx, noise_xx, filters, along_x=True),
            "eyy": amplitude_kept(strain.eyy, noise_yy, filters, along_x=False),
        }

    @property
    def amplitude_lost(self) -> dict[str, float]:
        """Fraction of the root mean square of "exx" and "eyy" that the settings remove; NaN if unknown."""
        kept = self.amplitude_kept
        return {name: amplitude_lost(getattr(self.strain, name), kept[name]) for name in kept}

    @property
    def strain_reasons(self) -> NDArray[np.str_]:
        """The reason why a point has no local strain, shape (rows, columns); empty where it has one.

        "no displacement": the correlation of the point failed. "outside the calibration": the displacement is
        extrapolated. "too few neighbours": fewer points than the window needs lie on the point's piece of the
        surface and have a displacement.
        """
        return np.array(STRAIN_REASONS)[self.strain_reason_index]

    @property
    def strain_reason_index(self) -> NDArray[np.intp]:
        """The index of `strain_reasons` in `STRAIN_REASONS`, shape (rows, columns)."""
        valid = (self.calibrated or self.raw).valid
        reasons = np.where(valid, 1, 2)
        reasons[~self.field.converged] = 3
        reasons[np.isfinite(self.strain.exx)] = 0
        return reasons

    @property
    def good(self) -> bool:
        """True if at least half of the points in view converged and three or more give the mean strain."""
        return self.objection is None

    @property
    def objection(self) -> str | None:
        """The reason why the measurement is not good; None if it is good."""
        if 2 * self.field.count(Status.CONVERGED) < self.field.in_view:
            if 2 * self.field.count(Status.REPEATING) >= self.field.in_view:
                return "the pattern repeats, and nothing shows by how many periods most points have moved"
            return "fewer than half of the points in view converged; see their statuses"
        if self.raw_mean.points < _POINTS_OF_A_PLANE:
            where = "" if self.calibrated is None else " within the calibrated area"
            return f"fewer than {_POINTS_OF_A_PLANE} points converged{where}: too few for a mean strain"
        return None

    def summary(self) -> dict[str, Any]:
        """Return the results as a dict that can be written as JSON. `docs/results.md` explains the values."""
        field = self.field
        failures = {s.text: field.count(s) for s in Status if s is not Status.CONVERGED and field.count(s)}
        summary: dict[str, Any] = {
            "file": self.label,
            "points": field.in_view,
            "converged": field.count(Status.CONVERGED),
            "out_of_view": field.count(Status.OUT_OF_VIEW),
            "failures": failures,
            "remarks": remarks_on(field),
            "start": field.start,
            "updates": field.updates,
            "strain": vars(self.strain_settings)
            | {
                "gauge_px": self.gauge_px,
                "gauge_mm": self.gauge_mm,
                "resolution_px": round(self.resolution_px, 1),
                "amplitude_lost": {
                    name: None if math.isnan(lost) else lost for name, lost in self.amplitude_lost.items()
                },
            },
            "interpolation": self._interpolation(),
            "raw": self.raw_mean.as_dict(),
        }
        if self.calibrated_mean is not None:
            summary["calibrated"] = self.calibrated_mean.as_dict() | self.images_std
        return summary

    @property
    def images_std(self) -> dict[str, float | None]:
        """The parts `exx_std_images` … of the standard deviations of the mean calibrated strain.

        The dict is empty if all parts of the standard deviations come from the images.
        """
        if self.by_images is None:
            return {}
        own = self.by_images.as_dict()
        return {name: own[name.removesuffix("_images")] for name in IMAGES_KEYS}

    def _interpolation(self) -> dict[str, float | None]:
        """Return the smoothing, the predicted bias, and the uncertainty of mean strain from the bias."""
        # Take raw displacements, because result files keep only their errors. The bias of raw strain and the
        # bias of calibrated strain are nearly equal.
        valid = None if self.calibrated is None else self.calibrated.valid
        part = self.raw_bias or bias_of_mean(self.raw, valid, self.strain_settings.measure)
        u_px, v_px = self.field.greatest_bias_px
        return {"smoothing_px": self.field.smoothing_px, "bias_u_px": u_px, "bias_v_px": v_px} | {
            f"{name}_std": getattr(part, f"{name}_std") if part is not None else None
            for name in ("exx", "eyy", "exy")
        }


def measure(
    field: Field,
    calibration: Calibration | None = None,
    strain: StrainSettings | None = None,
    *,
    label: str = "",
) -> Measurement:
    """Return the result of `dic.measure`, but with the standard deviations that the images alone cause.

    `Measurement.sharing` adds the errors that the points share.
    """
    require_kind("field", field, Field, "correlate first: dic.Correlator(reference).correlate(image)")
    require_kind("calibration", calibration, Calibration | None, "read it with dic.load_calibration(path)")
    require_kind("strain", strain, StrainSettings | None, "give dic.StrainSettings(window_points=3)")
    strain = strain or StrainSettings()
    gauge_px = strain.gauge_px(field.settings)
    by_shape = strain.source == "shape"
    raw = raw_displacement(field, gradients=by_shape)
    if calibration is None:
        raw_mean, bias = mean_strain_and_bias(raw, None, strain.measure)
        return Measurement(label, field, raw, None, strain, gauge_px, None, raw_mean, None, raw_bias=bias)
    calibrated = calibrated_displacement(field, calibration, gradients=by_shape)
    raw_mean, bias = mean_strain_and_bias(raw, calibrated.valid, strain.measure)
    mean = mean_strain(calibrated, measure=strain.measure)
    gauge_mm = gauge_px * calibration.mm_per_px
    return Measurement(
        label, field, raw, calibrated, strain, gauge_px, gauge_mm, raw_mean, mean, raw_bias=bias
    )
