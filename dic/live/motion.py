"""The motion of a specimen out of the grid's plane, as a whole field gave it, and how it goes on since then."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from dic.calibration.calibration import Calibration
from dic.gauges.field import GaugeField, fields_of
from dic.out_of_plane.correction import Correction, points_of
from dic.out_of_plane.plane import Plane, moved_out_of_plane
from dic.out_of_plane.uncertainty import Points
from dic.strain.measurement import Measurement
from dic.typing import Float

_LEAST_S = 1e-3
"""Least time between two fields that is used, so that a repeated time gives no infinite rate."""

_KEPT = 0.5
"""Weight of the earlier errors of a prediction in their mean."""


@dataclass(frozen=True)
class Bend:
    """The curvature of a surface beside its plane: a quadratic function of the place.

    Attributes
    ----------
    terms : ndarray, shape (6,)
        Coefficients of X²/2, X Y, Y²/2, X, Y and 1 in the height above the plane, in mm.
    """

    terms: Float = field(default_factory=lambda: np.zeros(6))

    @classmethod
    def of(cls, displacement_mm: Float, after_mm: Float, centre_mm: Float) -> "Bend":
        """Fit the bend to the displacements (n, 2) that it causes at calibrated places (n, 2)."""
        design = _terms(after_mm)[:, None, :] * _ray(after_mm, centre_mm)[:, :, None]
        return cls(np.linalg.lstsq(design.reshape(-1, 6), displacement_mm.ravel(), rcond=1e-9)[0])

    def displacement(self, after_mm: Float, centre_mm: Float) -> Float:
        """Return the displacements (n, 2) that a camera sees at calibrated places (n, 2)."""
        return np.asarray((_terms(after_mm) @ self.terms)[:, None] * _ray(after_mm, centre_mm))


def _terms(mm: Float) -> Float:
    x, y = mm.T
    return np.column_stack([x * x / 2, x * y, y * y / 2, x, y, np.ones_like(x)])


def _ray(after_mm: Float, centre_mm: Float) -> Float:
    """Return the shift (n, 2) of calibrated places by a height of 1 mm."""
    return np.asarray((after_mm - centre_mm[:2]) / centre_mm[2])


@dataclass(frozen=True)
class SharedErrors:
    """Covariances, shape (3, 3), of errors of exx, eyy, exy that all points of a field share.

    Attributes
    ----------
    calibrated : ndarray
        Errors of calibrated strain.
    corrected : ndarray
        Errors of corrected strain, except those by the noise of the images.
    noise : ndarray
        Errors of corrected strain that the noise of the images causes through the correction.
    mounting : ndarray, shape (3, causes)
        See `Correction.mounting`.
    """

    calibrated: Float
    corrected: Float
    noise: Float
    mounting: Float


@dataclass(frozen=True)
class FieldMotion:
    """The motion out of the plane that a whole field showed, and what gauges need of the correction.

    Attributes
    ----------
    time_s : float
        Time of the frame, on the same clock as that of the live frames.
    plane : Plane
        The plane of the surface, relative to that in the reference.
    bend : Bend
        Its curvature since the reference.
    errors : SharedErrors
    declined : str
        The reason why the field could not be corrected; "" if it was. Calibrated strain has its errors.
    """

    time_s: float
    plane: Plane
    bend: Bend
    errors: SharedErrors
    declined: str = ""

    @classmethod
    def of(
        cls, measurement: Measurement, correction: Correction, calibration: Calibration, time_s: float
    ) -> "FieldMotion":
        """Return the motion of a field that one camera measured and corrected.

        `measurement`: the measurement with all its errors; see `dic.out_of_plane.correction.stated`.
        """
        fields = fields_of(measurement, correction, calibration)
        unknown = np.full((3, 3), np.nan)
        if "corrected" not in fields or correction.after is None:
            errors = SharedErrors(fields["calibrated"].shared, unknown, unknown, np.zeros((3, 0)))
            return cls(time_s, Plane(), Bend(), errors, correction.declined or "it is not corrected")
        points = points_of(measurement, calibration)
        return cls.of_points(time_s, points, correction, _errors(fields))

    @classmethod
    def of_points(
        cls, time_s: float, points: Points, correction: Correction, errors: SharedErrors
    ) -> "FieldMotion":
        """Return the motion that was subtracted from the displacements of a field's points."""
        plane, centre_mm = correction.after or Plane(), points.centre_mm
        plain = moved_out_of_plane(replace(points.displacement, noise=None), centre_mm, Plane(), plane)
        rest = (plain.vector - correction.displacement.vector)[points.use]
        return cls(time_s, plane, Bend.of(rest, points.after_mm, centre_mm), errors)

    @property
    def values(self) -> Float:
        """Slopes, shift and the terms of the bend, shape (9,)."""
        plane = self.plane
        return np.array([plane.slope_x, plane.slope_y, plane.shift_mm, *self.bend.terms])


def _errors(fields: Mapping[str, GaugeField]) -> SharedErrors:
    calibrated, corrected = fields["calibrated"], fields["corrected"]
    return SharedErrors(
        calibrated.shared, corrected.shared, corrected.common_noise, corrected.mounting
    )


class MotionTrack:
    """The motions of the fields so far, and the motion now that is expected from them.

    The last motion holds, or goes on as between the last two, whichever has been closer to the next one. How
    far it was off, per second, tells the error by the age of the motion.

    `effect`: function that returns the mean strains (3,) of the present frame, corrected for the motion with
    the given values (9,). `start_s`: time of the reference.
    """

    def __init__(self, start_s: float) -> None:
        self._times_s, self._values = [start_s], [np.zeros(9)]
        self._errors: dict[str, Float] = {}
        self.last: FieldMotion | None = None

    def take(self, motion: FieldMotion, effect: Callable[[Float], Float]) -> None:
        """Take the motion of a field. One that was not corrected, or is older than the last, changes nothing."""
        if motion.declined or (self.last is not None and motion.time_s <= self._times_s[-1]):
            return
        passed_s = max(motion.time_s - self._times_s[-1], _LEAST_S)
        true = effect(motion.values)
        for name in ("held", "continued"):
            off = (effect(self._expected(name, motion.time_s)) - true) / passed_s
            known = self._errors.get(name)
            # Without enough points of the gauges, the effect is not known.
            if np.isfinite(off).all():
                square = np.outer(off, off)
                self._errors[name] = square if known is None else _KEPT * known + (1.0 - _KEPT) * square
        self.last = motion
        self._times_s = [self._times_s[-1], motion.time_s]
        self._values = [self._values[-1], motion.values]

    def at(self, time_s: float) -> tuple[Plane, Bend, Float]:
        """Return plane and bend that are expected now, and the covariance (3, 3) of the strain by their age."""
        name = min(self._errors, key=lambda each: float(np.trace(self._errors[each])), default="held")
        values, unknown = self._expected(name, time_s), np.full((3, 3), np.nan)
        plane = Plane(*values[:3].tolist())
        return plane, Bend(values[3:]), self._errors.get(name, unknown) * self.age_s(time_s) ** 2

    def age_s(self, time_s: float) -> float:
        """Return the age of the last motion."""
        return max(0.0, time_s - self._times_s[-1])

    def _expected(self, name: str, time_s: float) -> Float:
        last = self._values[-1]
        if name == "held" or len(self._values) < 2:
            return last
        share = (time_s - self._times_s[-1]) / max(self._times_s[-1] - self._times_s[-2], _LEAST_S)
        return np.asarray(last + share * (last - self._values[-2]))
