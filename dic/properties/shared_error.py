"""The effect of errors common to all points: of the calibration, of out-of-plane motion, and of time.

Such an error of the strain does not average out over the points of a curve. In the reference image the
strain is exactly zero and has no error, so the error grows during the test. There are two kinds of such
errors:

- If the cause was not measured, it is not known how the error grows. An example is the shift of the specimen
  towards the camera. This module assumes that the error grows in proportion to the load up to the end of the
  elastic window, where it reaches its stated standard deviation.
- If the cause is the same in all images, the error follows the measured motion of the specimen. An example is
  a specimen whose surface is not exactly parallel to the grid. The error is then known for each image, but
  for a factor that is the same in all images.
"""

from dataclasses import dataclass, replace

import numpy as np

from dic.properties.elastic import Elastic
from dic.properties.properties import Properties, material_properties
from dic.properties.strength import strength_point
from dic.typing import Float

NECKING = "necking"

_LOST = "strain error: the value does not exist if the strain is wrong by one standard deviation"
_LOST_BY_DELAY = "delay: the value does not exist if the load's delay is wrong by one standard deviation"
_LOST_BY_CLOCK = "clock: the value does not exist if the machine's clock is wrong by one standard deviation"


@dataclass(frozen=True)
class JoinError:
    """The errors of the loads of a record that was joined to images by time.

    Attributes
    ----------
    load_n : ndarray, shape (n, 2)
        Change of the load at each point if the offset, or the rate, of the machine's clock is larger by one
        standard deviation.
    correlation : float
        Correlation of the errors of offset and rate.
    """

    load_n: Float
    correlation: float = 0.0


def with_shared_error(
    found: Properties,
    shared_std: Float,
    shared_transverse: Float | None = None,
    followed: Float | None = None,
) -> Properties:
    """Return properties whose deviations contain a strain error that does not average out over the curve.

    For each independent error, each property is computed two more times: with the error added to the strain,
    and with the error subtracted. Half of the difference of the two values is the error of the property. If
    one of them does not exist, the difference from the property itself is used. If none exists, the standard
    deviation of the property is not known, and becomes None.

    Parameters
    ----------
    found : Properties
    shared_std : ndarray, shape (n,)
        Standard deviation, at each point of the curve, of the error whose growth is not known. If it comes
        from a `GaugeCurve`, give `followed` as well, because `GaugeCurve.shared_std` does not contain it.
    shared_transverse : ndarray, shape (n, 2), optional
        Error of the transverse strain. The first column is the change of the transverse strain, with its
        sign, when the error of the axial strain is one standard deviation. The second column is the standard
        deviation of the independent part. Without this argument, the transverse strain has no such error.
        Example: a shift towards the camera adds the same error to both strains. The shift changes Poisson's
        ratio by (1 + ν) times the relative error of the axial strain.
    followed : ndarray, shape (n, 2, causes), optional
        Errors of the axial and of the transverse strain at each point that follow the measured motion. Each
        cause differs by one standard deviation from its expected value. The causes are independent.
    """
    elastic = found.elastic
    curve = found.record.curve
    if elastic is None or not np.isfinite(shared_std[np.isfinite(curve.strain)]).all():
        return found
    errors = _errors(found, elastic, shared_std, shared_transverse, followed)
    none = np.zeros(len(shared_std))
    changes = [_changes(found, elastic, np.vstack([error, none])) for error in errors]
    parts = {
        name: float(np.linalg.norm([each[name] for each in changes if name in each]))
        for name in dict.fromkeys(name for each in changes for name in each)
    }
    return replace(_with_parts(found, parts, _LOST), strain_parts=_finite(parts))


def with_join_error(found: Properties, error: JoinError) -> Properties:
    """Return properties whose deviations contain the errors of offset and rate of the machine's clock.

    Each property is computed with the loads at a clock that is wrong by one standard deviation, as in
    `with_shared_error`.
    """
    if found.elastic is None:
        return found
    none = np.zeros((2, len(error.load_n)))
    changes = [_changes(found, found.elastic, np.vstack([none, load_n])) for load_n in error.load_n.T]
    pairs = {name: (change, changes[1][name]) for name, change in changes[0].items()}
    parts = {
        name: float(np.sqrt(max(a * a + b * b + 2.0 * error.correlation * a * b, 0.0)))
        for name, (a, b) in pairs.items()
    }
    names = ("offset", "clock_rate", "both")
    shares = {
        name: dict(zip(names, (abs(pairs[name][0]), abs(pairs[name][1]), part), strict=True))
        for name, part in _finite(parts).items()
    }
    return replace(_with_parts(found, parts, _LOST_BY_CLOCK), join_parts=shares)


def with_delay_error(found: Properties, lag_n: Float, lag_strain: Float | None = None) -> Properties:
    """Return properties whose deviations contain an error of time that all images of a run share.

    Each property is computed with loads, and with strains of a measured signal, at a time that is wrong by
    one standard deviation, as in `with_shared_error`.

    Parameters
    ----------
    found : Properties
    lag_n : ndarray, shape (n,)
        Change of the load at each point if the images were taken later by one standard deviation.
    lag_strain : ndarray, shape (n,), optional
        Such a change of the strain, whose cause is independent of that of the load's. Default: 0, for strain
        from the images themselves.
    """
    if found.elastic is None:
        return found
    none = np.zeros(len(lag_n))
    causes = [np.array([none, none, lag_n])]
    if lag_strain is not None:
        causes.append(np.array([_filled(lag_strain), none, none]))
    changes = [_changes(found, found.elastic, cause) for cause in causes]
    parts = {name: float(np.linalg.norm([each[name] for each in changes])) for name in changes[0]}
    return replace(_with_parts(found, parts, _LOST_BY_DELAY), delay_parts=_finite(parts))


def _finite(parts: dict[str, float]) -> dict[str, float]:
    return {name: part for name, part in parts.items() if np.isfinite(part)}


def _with_parts(found: Properties, parts: dict[str, float], lost: str) -> Properties:
    """Return properties with further parts of their deviations; an unknown part gives the flag `lost`."""
    values = dict(found.values | {NECKING: found.necking})
    for name, part in parts.items():
        value = values[name]
        if np.isfinite(part):
            values[name] = replace(value, std=float(np.hypot(value.std or 0.0, part)))
        else:
            values[name] = replace(value, std=None, flags=(*value.flags, lost))
    neck = values.pop(NECKING)
    return replace(found, values=values, necking=neck)


def _errors(
    found: Properties,
    elastic: Elastic,
    shared_std: Float,
    shared_transverse: Float | None,
    followed: Float | None,
) -> list[Float]:
    """Return independent errors of axial and transverse strain, each of shape (2, n), at all points."""
    curve = found.record.curve
    points, none = np.arange(len(shared_std)), np.zeros(len(shared_std))
    along = np.asarray(np.nan_to_num(shared_std), np.float64)
    known = none > 0.0 if curve.transverse is None else np.isfinite(curve.transverse)
    grown = [np.array([along, none])]
    if shared_transverse is not None and np.isfinite(shared_transverse[known]).all():
        # Points without a transverse strain get an interpolated error from the points around them.
        beside = [none, none]
        if known.any():
            beside = [np.interp(points, points[known], part[known]) for part in shared_transverse.T]
        grown = [np.array([along, beside[0]]), np.array([none, beside[1]])]
    end = elastic.line.stop
    for error in grown:
        error[:, :end] = error[:, end - 1 : end] * curve.load_n[:end] / curve.load_n[end - 1]
    causes = np.zeros((0, len(points), 2)) if followed is None else np.moveaxis(followed, 2, 0)
    return grown + [np.array([_filled(row) for row in cause.T]) for cause in causes]


def _filled(values: Float) -> Float:
    """Return values whose NaN are interpolated from the values around them; 0 if all are NaN."""
    points, known = np.arange(len(values)), np.isfinite(values)
    return np.interp(points, points[known], values[known]) if known.any() else np.zeros(len(values))


def _below_largest(error_n: Float, load_n: Float, largest: int) -> Float:
    """Return errors of the loads that lift no load after the largest one above it.

    At the break the load falls steeply, and an error of time times its rate is large. An image at another
    time would show another load of this fall, but none above its beginning.
    """
    fallen_n, of_largest_n = load_n[largest] - load_n, error_n[largest]
    bounded = of_largest_n + np.clip(error_n - of_largest_n, -np.abs(fallen_n), np.abs(fallen_n))
    return np.where(np.arange(len(load_n)) > largest, bounded, error_n)


def _changes(found: Properties, elastic: Elastic, error: Float) -> dict[str, float]:
    """Return by how much the errors of axial strain, transverse strain and load change each property."""
    curve = found.record.curve
    late_n = _below_largest(error[2], curve.load_n, strength_point(found.record, found.plateau))
    # Use the same window for both curves, so that the difference does not contain the choice of a window.
    window = elastic.line.first, elastic.line.stop
    sides = []
    for sign in (1.0, -1.0):
        beside = None if curve.transverse is None else curve.transverse + sign * error[1]
        along, load_n = curve.strain + sign * error[0], curve.load_n + sign * late_n
        moved = replace(curve, strain=along, transverse=beside, load_n=load_n)
        side = material_properties(moved, found.settings, window)
        sides.append(side.values | {NECKING: side.necking})
    changes = {}
    for name, value in (found.values | {NECKING: found.necking}).items():
        if value.value is None or value.std is None:
            continue
        ends = [side[name].value for side in sides if name in side]
        there = [end for end in ends if end is not None]
        changes[name] = np.nan
        if there:
            opposite = there[-1] if len(there) == 2 else 2.0 * value.value - there[0]
            changes[name] = 0.5 * (there[0] - opposite)
    return changes
