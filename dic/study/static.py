"""Recognise images of the specimen at rest, and estimate the strain wave in an image of a loaded specimen."""

import math
from dataclasses import dataclass

import numpy as np

from dic.correlation.correlator import Correlator
from dic.correlation.field import Field
from dic.correlation.settings import CorrelationSettings
from dic.errors import CorrelationError
from dic.strain.measurement import measure
from dic.strain.resolution import Filters
from dic.strain.settings import StrainSettings
from dic.study.wave import Wave
from dic.typing import Float, Grey, Mask

_MOVED_PX = 0.5
_STRAINED = 3e-4
"""Largest motion in px, and largest strain or rotation, of a specimen at rest, for example in the image of a
camera that warms up.
"""
_SCATTER = 1.5
"""Largest scatter of the displacements of a specimen at rest, divided by the scatter that white noise
causes.
"""
_NAMED_SCATTER = 4.0
"""The same limit for an image that the user names as the image at rest. The limit is higher because smoothed
noise, from the camera or the file format, scatters the displacements more than white noise.
"""

_PLANE = 0.25
"""A wave counts as plane if its wave number across the direction of the strain is below this fraction of its
wave number along this direction.
"""
_LEAST_KEPT = 0.4
"""Smallest share of the amplitude that the correction assumes to be left, because little strain does not
allow a larger correction.
"""
_STRONGEST = 0.2
_LONGEST = 50.0
"""Largest amplitude, and largest period in widths of the virtual strain gauge, of an estimated wave."""


@dataclass(frozen=True)
class StaticMotion:
    """How a second image differs from the reference."""

    moved_px: float
    """Mean displacement."""
    strained: float
    """Largest element of the mean displacement gradient, as an absolute value."""
    scatter: float
    """Scatter of the displacements about a uniform deformation, divided by the scatter that noise explains.
    """

    @classmethod
    def of(cls, field: Field) -> "StaticMotion":
        """Return the mean motion, the strain and the scatter of a displacement field."""
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
        """True if the specimen moved and deformed so little that it counts as a specimen at rest."""
        return self.is_within(_SCATTER)

    def is_within(self, scatter: float) -> bool:
        """Return True if motion and strain are small enough for rest, and the scatter is at most the given
        one.
        """
        return self.moved_px <= _MOVED_PX and self.strained <= _STRAINED and self.scatter <= scatter

    def __str__(self) -> str:
        return (
            f"motion {self.moved_px:.3f} px, strain or rotation {1e6 * self.strained:.0f} µε,"
            f" scatter {self.scatter:.2f} times that of noise"
        )


def motion_between(grey: Grey, other: Grey, region: Mask, settings: CorrelationSettings) -> Field:
    """Correlate two images with the default subset; the field shows whether the specimen is at rest."""
    step_px = max(10, 2 * round(math.sqrt(np.count_nonzero(region) / 5000) / 2))
    used = CorrelationSettings(step_px=step_px, order=settings.order, smoothing_px=settings.smoothing_px)
    return Correlator(grey, region, used, copy=False).correlate(other)


def require_rest(motion: StaticMotion, label: str) -> None:
    """Raise a `CorrelationError` if the user named an image as one at rest, but it shows more than noise."""
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

    The strain is measured with the default subset and window. Its mean and its noise are subtracted. The mean
    square difference of neighbouring points then gives the mean wave numbers along and across the direction
    of the strain. The settings reduce the amplitude of such a wave, and the mean square is corrected for this
    loss. The wave follows from exx or eyy, whichever has the larger mean square.

    Raises `CorrelationError` if the strain varies too little to be distinguished from its noise.
    """
    used = CorrelationSettings(order=settings.order, smoothing_px=settings.smoothing_px)
    strain = StrainSettings()
    filters = Filters(used, strain)
    local = measure(Correlator(grey, region, used, copy=False).correlate(deformed), strain=strain).strain
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
    """Return mean square and wave numbers (along and across, rad/px) of a strain; None if only noise."""
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
    """Return the mean phase difference φ, rad, between neighbouring points of waves with mean square s.

    The mean square difference of neighbouring points is 2 s (1 - cos φ), plus a part 2 · `noise` that the
    noise of the strain adds. The mean product of neighbours would depend on where the points end; the mean
    square difference does not.
    """
    ahead = values.take(range(1, values.shape[axis]), axis)
    behind = values.take(range(values.shape[axis] - 1), axis)
    difference = float(np.nanmean((ahead - behind) ** 2)) / 2.0 - noise
    return math.acos(min(1.0, max(-1.0, 1.0 - difference / square)))
