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
"""Largest scatter of the displacements of a specimen at rest, relative to what noise explains."""


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
        return self.moved_px <= _MOVED_PX and self.strained <= _STRAINED and self.scatter <= _SCATTER

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
    if not motion.at_rest:
        raise CorrelationError(
            label,
            "compare with the reference",
            f"the specimen at rest: motion up to {_MOVED_PX:g} px, strain up to {1e6 * _STRAINED:.0f} µε,"
            f" scatter up to {_SCATTER:g} times that of noise",
            str(motion),
            "take two images directly one after the other, or leave out --static",
        )


def wave_of(grey: Grey, deformed: Grey, region: Mask, settings: CorrelationSettings, label: str) -> Wave:
    """Return the wave that loses as much strain as the measured strain of a deformed image does.

    The strain is measured with the default subset and window. After its mean and its noise have been
    subtracted, the mean product of neighbouring values gives its mean wave number along and across the
    direction of the derivative. The result is the wave that keeps the same share of its amplitude, with the
    measured mean square, corrected for this share.

    Raises
    ------
    CorrelationError
        If the strain varies too little to be distinguished from its noise.
    """
    used = CorrelationSettings(order=settings.order, smoothing_px=settings.smoothing_px)
    strain = StrainSettings()
    filters = Filters(used, strain)
    local = measure(Correlator(grey, region, used).correlate(deformed), strain=strain).strain
    found = []
    for values, std, axis in ((local.exx, local.exx_std, 1), (local.eyy, local.eyy_std, 0)):
        variance = np.nanmean(std**2)
        values = values - np.nanmean(values)
        square = float(np.nanmean(values**2) - variance)
        if not square > variance:
            continue
        kept = 1.0
        for along, own_axis in ((True, axis), (False, 1 - axis)):
            correlation = float(filters.noise_correlation(along=along)[1])
            phase = _phase(values, own_axis, square, correlation * float(variance))
            transfer = filters.along if along else filters.across
            kept *= float(transfer(np.array([phase / used.step_px]))[0])
        found.append((square / kept**2, kept))
    if not found:
        raise CorrelationError(
            label,
            "estimate the assumed strain",
            "a strain that varies by more than its noise",
            "hardly any variation",
            "leave the image out, and give --period-px and --strain-amplitude",
        )
    square, kept = max(found)
    return Wave(_period_px(filters, kept), min(0.2, math.sqrt(2.0 * square)))


def _phase(values: Float, axis: int, square: float, noise: float) -> float:
    """Return the mean phase, rad, between neighbouring points of waves of a mean square."""
    ahead = values.take(range(1, values.shape[axis]), axis)
    behind = values.take(range(values.shape[axis] - 1), axis)
    return math.acos(min(1.0, max(-1.0, (float(np.nanmean(ahead * behind)) - noise) / square)))


def _period_px(filters: Filters, kept: float) -> float:
    """Return the period of the wave that keeps a share of its amplitude."""
    from scipy.optimize import brentq

    gauge_px = filters.strain.gauge_px(filters.correlation)
    shortest, longest = 0.6 * gauge_px, 50.0 * gauge_px

    def excess(period_px: float) -> float:
        return float(filters.along(np.array([2.0 * math.pi / period_px]))[0]) - kept

    if excess(longest) < 0.0:
        return longest
    if excess(shortest) > 0.0:
        return shortest
    return float(brentq(excess, shortest, longest))


def unreadable(label: str, error: MeasurementError) -> MeasurementError:
    """Return an error that names the image which cannot be compared with the reference."""
    return type(error)(label, error.step, error.expected, error.got, error.remedy)
