"""Recognise images of the specimen at rest, and estimate the wave of strain in an image of the loaded one."""

import math
from dataclasses import dataclass

import numpy as np

from dic.correlation.correlator import Correlator
from dic.correlation.field import Field
from dic.correlation.settings import CorrelationSettings
from dic.errors import CorrelationError, MeasurementError
from dic.strain.measurement import measure
from dic.strain.resolution import Filters
from dic.strain.strain import StrainSettings
from dic.study.wave import Wave
from dic.typing import Float, Grey, Mask

_MOVED_PX = 0.5
_STRAINED = 3e-4
"""Largest motion and largest strain or rotation, such as from a warming camera, of a specimen at rest."""
_SCATTER = 1.5
"""Largest scatter of the displacements of a specimen at rest, relative to what white noise explains."""
_NAMED_SCATTER = 4.0
"""The same for an image that the user names: noise that the camera or the file format has smoothed scatters
the displacements more than white noise does."""

_PLANE = 0.25
"""A strain whose wave number across its direction is below this fraction of that along it counts as plane."""
_LEAST_KEPT = 0.4
"""Larger losses of amplitude are not corrected: little of the strain is left to conclude from."""
_STRONGEST = 0.2
_LONGEST = 50.0
"""Largest amplitude, and largest period in widths of the virtual strain gauge, of an estimated wave."""


@dataclass(frozen=True)
class Motion:
    """How a second image differs from the reference.

    Attributes
    ----------
    moved_px : float
        Mean displacement.
    strained : float
        Largest element of the mean displacement gradient, as an absolute value.
    scatter : float
        Scatter of the displacements about a uniform deformation, divided by the scatter that noise explains.
    """

    moved_px: float
    strained: float
    scatter: float

    @classmethod
    def of(cls, field: Field) -> "Motion":
        """Return the motion of a displacement field."""
        use = field.converged
        at = field.points.reshape(*use.shape, 2)[use]
        at = at - at.mean(axis=0)
        uv = np.stack([field.u_px, field.v_px], axis=-1)[use]
        terms = np.column_stack([np.ones(len(at)), at])
        plane = np.linalg.lstsq(terms, uv, rcond=None)[0]
        rest = uv - terms @ plane
        explained = float(np.sqrt((field.noise_std_px[use] ** 2).mean()))
        moved_px = float(np.hypot(*plane[0]))
        return cls(moved_px, float(np.abs(plane[1:]).max()), float(np.sqrt((rest**2).mean())) / explained)

    @property
    def at_rest(self) -> bool:
        """True if the specimen has moved and deformed so little that the image shows it at rest."""
        return self.is_within(_SCATTER)

    def is_within(self, scatter: float) -> bool:
        """Return True if motion, strain and scatter do not exceed those of a specimen at rest."""
        return self.moved_px <= _MOVED_PX and self.strained <= _STRAINED and self.scatter <= scatter

    def __str__(self) -> str:
        return (
            f"motion {self.moved_px:.3f} px, strain or rotation {1e6 * self.strained:.0f} µε,"
            f" scatter {self.scatter:.2f} times that of noise"
        )


def motion_between(grey: Grey, other: Grey, region: Mask, settings: CorrelationSettings) -> Field:
    """Return the displacement field by which an image at rest is recognised, with the default subset."""
    step_px = max(10, 2 * round(math.sqrt(np.count_nonzero(region) / 5000) / 2))
    used = CorrelationSettings(step_px=step_px, order=settings.order, smoothing_px=settings.smoothing_px)
    return Correlator(grey, region, used).correlate(other)


def require_rest(motion: Motion, label: str) -> None:
    """Raise an error if an image that is said to show the specimen at rest shows more than noise.

    Raises
    ------
    CorrelationError
    """
    if not motion.is_within(_NAMED_SCATTER):
        raise CorrelationError(
            label,
            "compare with the reference",
            f"the specimen at rest: motion up to {_MOVED_PX:g} px, strain up to {1e6 * _STRAINED:.0f} µε,"
            f" scatter up to {_NAMED_SCATTER:g} times that of noise",
            str(motion),
            "take two images directly one after the other, or leave out --static",
        )


def wave_of(grey: Grey, deformed: Grey, region: Mask, settings: CorrelationSettings, label: str) -> Wave:
    """Return a wave that has the wave numbers and the mean square of the strain of a deformed image.

    The strain is measured with the default subset and window. After its mean and its noise have been
    subtracted, the mean square difference of neighbours gives its mean wave numbers along and across the
    direction of the derivative. The mean square is corrected for the share of such a wave that the settings
    keep. Of exx and eyy, the one with the larger mean square counts.

    Raises
    ------
    CorrelationError
        If the strain varies too little to be distinguished from its noise.
    """
    used = CorrelationSettings(order=settings.order, smoothing_px=settings.smoothing_px)
    strain = StrainSettings()
    filters = Filters(used, strain)
    local = measure(Correlator(grey, region, used).correlate(deformed), strain=strain).strain
    found = [
        each
        for values, std, axis in ((local.exx, local.exx_std, 1), (local.eyy, local.eyy_std, 0))
        if (each := _waves(values, std, axis, filters)) is not None
    ]
    if not found:
        raise CorrelationError(
            label,
            "estimate the assumed strain",
            "a strain that varies by more than its noise",
            "hardly any variation",
            "leave the image out and give --period-px, or name it by --static if the specimen is at rest",
        )
    square, along, across = max(found)
    period_px = min(_LONGEST * strain.gauge_px(used), 2.0 * math.pi / along)
    if across < _PLANE * along:
        return Wave(period_px, min(_STRONGEST, math.sqrt(2.0 * square)))
    return Wave(period_px, min(_STRONGEST, math.sqrt(4.0 * square)), 2.0 * math.pi / across)


def _waves(values: Float, std: Float, axis: int, filters: Filters) -> tuple[float, float, float] | None:
    """Return the mean square of a strain and its wave numbers along and across, 1/px; None if it is noise."""
    variance = float(np.nanmean(std**2))
    values = values - np.nanmean(values)
    square = float(np.nanmean(values**2)) - variance
    if not square > variance:
        return None
    kept, per_px = 1.0, []
    for along, own_axis in ((True, axis), (False, 1 - axis)):
        correlation = float(filters.noise_correlation(along=along)[1])
        phase = max(1e-3, _phase(values, own_axis, square, (1.0 - correlation) * variance))
        per_px.append(phase / filters.correlation.step_px)
        transfer = filters.along if along else filters.across
        kept *= float(transfer(np.array(per_px[-1:]))[0])
    kept = max(_LEAST_KEPT, kept)
    return square / kept**2, per_px[0], per_px[1]


def _phase(values: Float, axis: int, square: float, noise: float) -> float:
    """Return the mean phase φ, rad, between neighbouring points of waves of a mean square s.

    The mean square of the difference of neighbours is 2 s (1 - cos φ), beside twice the variance `noise` that
    the noise of the difference adds. Unlike the mean product, it does not depend on where the points end.
    """
    ahead = values.take(range(1, values.shape[axis]), axis)
    behind = values.take(range(values.shape[axis] - 1), axis)
    difference = float(np.nanmean((ahead - behind) ** 2)) / 2.0 - noise
    return math.acos(min(1.0, max(-1.0, 1.0 - difference / square)))


def unreadable(label: str, error: MeasurementError) -> MeasurementError:
    """Return an error that names the image which cannot be compared with the reference."""
    return type(error)(label, error.step, error.expected, error.got, error.remedy)
