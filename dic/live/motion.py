"""The motion of a specimen out of the grid's plane, as a whole field gave it, and how it goes on."""

from dataclasses import dataclass, field, replace

import numpy as np

from dic.calibration.calibration import Calibration
from dic.gauges.field import fields_of
from dic.out_of_plane.correction import Correction, points_of
from dic.out_of_plane.plane import Plane, moved_out_of_plane
from dic.out_of_plane.uncertainty import Points
from dic.strain.measurement import Measurement
from dic.typing import Float

VALUES = 9
"""Number of values of a motion: two slopes, the shift, and the six terms of the bend."""

_LEAST_S = 0.05
"""Least time between two fields from which a rate is computed."""

_RANK = 1e-9
"""Terms of a bend that cause less than this share of the largest displacement are left out."""

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
        found = np.linalg.lstsq(design.reshape(-1, 6), displacement_mm.ravel(), rcond=_RANK)[0]
        return cls(np.asarray(found, np.float64))

    def heights(self, mm: Float) -> Float:
        """Return the heights above the plane, mm, shape (n,), at places (n, 2)."""
        return np.asarray(_terms(mm) @ self.terms)

    def displacement(self, after_mm: Float, centre_mm: Float) -> Float:
        """Return the displacements (n, 2) that a camera sees at calibrated places (n, 2)."""
        return np.asarray(self.heights(after_mm)[:, None] * _ray(after_mm, centre_mm))


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
    centre_mm : ndarray, shape (3,), or None
        The camera's centre in the axes of the surface, if the field tells it better than the calibration.
    declined : str
        The reason why the field could not be corrected; "" if it was. Calibrated strain has its errors.
    """

    time_s: float
    plane: Plane
    bend: Bend
    errors: SharedErrors
    centre_mm: Float | None = None
    declined: str = ""

    @classmethod
    def of(
        cls,
        measurement: Measurement,
        correction: Correction,
        calibration: Calibration,
        time_s: float,
        seen: tuple[Points, Float] | None = None,
    ) -> "FieldMotion":
        """Return the motion of a field of one camera that was corrected.

        `measurement`: the measurement with all its errors; see `dic.out_of_plane.correction.stated`.
        `seen`: the points with which it was corrected, and the camera's centre, shape (3,), in the axes of
        the surface. Default: those of a correction by one camera.
        """
        fields = fields_of(measurement, correction, calibration)
        unknown = np.full((3, 3), np.nan)
        if "corrected" not in fields or correction.after is None:
            errors = SharedErrors(fields["calibrated"].shared, unknown, unknown, np.zeros((3, 0)))
            why = correction.declined or "it is not corrected"
            return cls(time_s, Plane(), Bend(), errors, declined=why)
        if seen is None:
            points = points_of(measurement, calibration)
            seen = points, points.centre_mm
        (points, centre_mm), plane = seen, correction.after
        plain = moved_out_of_plane(replace(points.displacement, noise=None), centre_mm, Plane(), plane)
        rest = (plain.vector - correction.displacement.vector)[points.use]
        bend = Bend.of(rest, points.after_mm, centre_mm)
        calibrated, corrected = fields["calibrated"], fields["corrected"]
        errors = SharedErrors(calibrated.shared, corrected.shared, corrected.common_noise, corrected.mounting)
        return cls(time_s, plane, bend, errors, centre_mm)

    @property
    def values(self) -> Float:
        """Slopes, shift and the terms of the bend, shape (9,)."""
        plane = self.plane
        return np.array([plane.slope_x, plane.slope_y, plane.shift_mm, *self.bend.terms])


class MotionTrack:
    """The motions of the fields so far, and the motion now that is expected from them.

    The last motion holds, or goes on as between the last two, whichever has been closer to the next one. How
    far it was off, per second, tells the error by the age of the motion.

    `start_s`: time of the reference, in which there was no motion.
    """

    def __init__(self, start_s: float) -> None:
        self._times_s, self._values = [start_s], [np.zeros(VALUES)]
        self._errors: dict[str, Float] = {}
        self.by_values = np.full((3, VALUES), np.nan)
        """Derivatives of the mean strains exx, eyy, exy of the gauges' points by the values of the motion."""
        self.last: FieldMotion | None = None
        self._better = "held"

    def take(self, motion: FieldMotion, by_values: Float) -> None:
        """Take the motion of a field. One that was not corrected, or is older than the last, changes nothing.

        `by_values`, shape (3, 9): derivatives of the strains at present; NaN if they are not known.
        """
        if np.isfinite(by_values).all():
            self.by_values = by_values
        if motion.declined or (self.last is not None and motion.time_s <= self._times_s[-1]):
            return
        passed_s = motion.time_s - self._times_s[-1]
        for name in ("held", "continued") if passed_s > _LEAST_S else ():
            off = (self._expected(name, motion.time_s) - motion.values) / passed_s
            square, known = np.outer(off, off), self._errors.get(name)
            self._errors[name] = square if known is None else _KEPT * known + (1.0 - _KEPT) * square
        self.last = motion
        self._times_s = [self._times_s[-1], motion.time_s]
        self._values = [self._values[-1], motion.values]
        to_strain = np.nan_to_num(self.by_values)
        self._better = min(
            self._errors,
            key=lambda each: float(np.trace(to_strain @ self._errors[each] @ to_strain.T)),
            default="held",
        )

    def at(self, time_s: float) -> tuple[Float, Float]:
        """Return the values (9,) that are expected now, and the covariance (9, 9) of their errors by age."""
        name = self._better
        unknown = np.full((VALUES, VALUES), np.nan)
        return self._expected(name, time_s), self._errors.get(name, unknown) * self.age_s(time_s) ** 2

    def age_s(self, time_s: float) -> float:
        """Return the age of the last motion."""
        return max(0.0, time_s - self._times_s[-1])

    def _expected(self, name: str, time_s: float) -> Float:
        last = self._values[-1]
        if name == "held" or len(self._values) < 2:
            return last
        share = (time_s - self._times_s[-1]) / max(self._times_s[-1] - self._times_s[-2], _LEAST_S)
        return np.asarray(last + share * (last - self._values[-2]))
