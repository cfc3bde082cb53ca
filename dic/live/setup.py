"""What a live measurement of one camera begins with, and what is prepared from it."""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dic.calibration.calibration import Calibration
from dic.correlation.correlator import Correlator
from dic.correlation.settings import CorrelationSettings
from dic.errors import GaugeError
from dic.gauges.declared import Gauge
from dic.gauges.placed import PlacedGauges
from dic.live.fields import reference_field
from dic.live.settings import LiveSettings
from dic.out_of_plane.correct import correct
from dic.out_of_plane.correction import stated
from dic.out_of_plane.motion import Motion
from dic.strain.measurement import Measurement, measure
from dic.strain.settings import StrainSettings
from dic.typing import Float, Mask, PathLike


@dataclass(frozen=True)
class LiveSetup:
    """What determines the live measurement of one camera, as it determines the offline one.

    Attributes
    ----------
    reference : ndarray, shape (height, width)
        Grey levels of the reference image, of the same type as the frames if possible.
    gauges : sequence of Gauge
    calibration : Calibration, optional
        Without a calibration, strains are raw.
    correlation : CorrelationSettings
    strain : StrainSettings
    region : ndarray of bool, shape (height, width), or path, optional
        As for `Correlator`. Default: the specimen.
    clip : bool
        As for `Correlator`.
    within : ndarray of bool, shape (height, width), optional
        As for `Correlator`.
    motion : Motion, optional
        Expected motion of the specimen, to correct for motion out of the plane: "tension". Default: strains
        are not corrected.
    live : LiveSettings
    """

    reference: NDArray[Any]
    gauges: Sequence[Gauge]
    calibration: Calibration | None = None
    correlation: CorrelationSettings = field(default_factory=CorrelationSettings)
    strain: StrainSettings = field(default_factory=StrainSettings)
    region: Mask | PathLike | None = None
    clip: bool = True
    within: Mask | None = None
    motion: Motion | None = None
    live: LiveSettings = field(default_factory=LiveSettings)

    def __post_init__(self) -> None:
        if not self.gauges:
            remedy = "declare at least one gauge"
            raise GaugeError("live gauges", "begin", "gauges", "none", remedy)
        if self.motion is not None and self.motion.kind != "tension":
            remedy = "give the motion tension, or none"
            raise GaugeError("live gauges", "correct", "the motion tension", self.motion.kind, remedy)

    def __getstate__(self) -> dict[str, Any]:
        # Another process prepares the reference for itself.
        return {item.name: getattr(self, item.name) for item in fields(self)}

    def __repr__(self) -> str:
        height, width = self.reference.shape
        return f"LiveSetup({width} × {height} px, {', '.join(gauge.name for gauge in self.gauges)})"

    @cached_property
    def correlator(self) -> Correlator:
        """The correlator of the reference, as offline."""
        return Correlator(
            self.reference, self.region, self.correlation, clip=self.clip, within=self.within, threads=1
        )

    @cached_property
    def at_rest(self) -> Measurement:
        """The measurement of the reference with itself."""
        correlator = self.correlator
        field = reference_field(correlator.prepared, correlator.region)
        return measure(field, self.calibration, self.strain, label="reference")

    @property
    def at_rest_errors(self) -> Float | None:
        """Covariance (3, 3) of errors of calibrated exx, eyy, exy that all points share, before any motion.

        None without a calibration.
        """
        if self.calibration is None:
            return None
        free = Motion() if self.motion is None else replace(self.motion, kind="free")
        unknown = correct([self.at_rest], self.calibration, free).images[0]
        return stated(self.at_rest, unknown).shared

    @cached_property
    def placed(self) -> PlacedGauges:
        """The gauges with their points."""
        return PlacedGauges.of(self.gauges, self.at_rest, self.calibration, self.reference.shape)

    @property
    def needed(self) -> Mask:
        """The points that gauges need, shape (rows, columns)."""
        needed = np.zeros(self.correlator.grid.active.shape, np.bool_)
        for placed in self.placed.placed:
            needed[placed.points()] = True
        return needed


def calibrations_of(first: LiveSetup, second: LiveSetup) -> tuple[Calibration, Calibration]:
    """Return the calibrations of both cameras; raise a GaugeError if one has no pinhole model."""
    one, other = first.calibration, second.calibration
    if one is None or other is None or one.pinhole is None or other.pinhole is None:
        raise GaugeError(
            "live gauges of two cameras",
            "correct for motion out of the plane",
            "calibrations with a pinhole model",
            "a camera without one",
            "calibrate both cameras with the same grid",
        )
    return one, other
