"""The effect of strain errors common to all points: errors of the calibration and of out-of-plane motion.

Such an error does not average out over the points of a curve. In the reference image the strain is exactly
zero and has no error, so the error grows during the test. This module assumes that the error grows in
proportion to the load up to the end of the elastic window, where it reaches its stated standard deviation. No
other assumption about the growth gives a larger change of the elastic slope.
"""

from dataclasses import replace

import numpy as np

from dic.properties.elastic import Elastic
from dic.properties.properties import Properties, material_properties
from dic.typing import Float

NECKING = "necking"


def with_shared_error(
    found: Properties, shared_std: Float, shared_transverse: Float | None = None
) -> Properties:
    """Return properties whose deviations contain a strain error that does not average out over the curve.

    Each property is computed two more times: with the error added to the strain, and with the error
    subtracted. Half of the difference of the two values is the error of the property.

    Parameters
    ----------
    found : Properties
    shared_std : ndarray, shape (n,)
        Standard deviation of the error at each point of the curve.
    shared_transverse : ndarray, shape (n, 2), optional
        Error of the transverse strain. The first column is the change of the transverse strain, with its
        sign, when the error of the axial strain is one standard deviation. The second column is the standard
        deviation of the independent part. Without this argument, the transverse strain has no such error.
        Example: a shift towards the camera adds the same error to both strains. The shift changes Poisson's
        ratio by (1 + ν) times the relative error of the axial strain.
    """
    elastic = found.elastic
    curve = found.record.curve
    if elastic is None or not np.isfinite(shared_std[np.isfinite(curve.strain)]).all():
        return found
    shared_std = np.asarray(np.nan_to_num(shared_std), np.float64)
    known = np.zeros(len(shared_std), np.bool_) if curve.transverse is None else np.isfinite(curve.transverse)
    modes: list[tuple[Float, Float]]
    if shared_transverse is None or not np.isfinite(shared_transverse[known]).all():
        modes = [(shared_std, np.zeros(len(shared_std)))]
    else:
        # Points without a transverse strain get an interpolated error from the points around them.
        points = np.arange(len(known))
        beside: list[Float] = [np.zeros(len(points))] * 2
        if known.any():
            beside = [np.interp(points, points[known], part[known]) for part in shared_transverse.T]
        modes = [(shared_std, beside[0]), (np.zeros(len(shared_std)), beside[1])]
    changes = [_changes(found, elastic, *mode) for mode in modes]
    values, parts = {}, {}
    for name, value in (found.values | {NECKING: found.necking}).items():
        values[name] = value
        own = [each[name] for each in changes if name in each]
        if len(own) == len(changes):
            parts[name] = float(np.linalg.norm(own))
            values[name] = replace(value, std=float(np.hypot(value.std or 0.0, parts[name])))
    neck = values.pop(NECKING)
    return replace(found, values=values, necking=neck, strain_parts=parts)


def _changes(found: Properties, elastic: Elastic, along: Float, across: Float) -> dict[str, float]:
    """Return by how much the given errors of axial and transverse strain change each property."""
    record = found.record
    curve, end = record.curve, elastic.line.stop
    errors = []
    for part in (along, across):
        error = np.array(part, np.float64)
        error[:end] = error[end - 1] * curve.load_n[:end] / curve.load_n[end - 1]
        errors.append(error)
    # Use the same window for both curves, so that the difference does not contain the choice of a window.
    window = elastic.line.first, elastic.line.stop
    sides = []
    for sign in (1.0, -1.0):
        beside = None if curve.transverse is None else curve.transverse + sign * errors[1]
        moved = replace(curve, strain=curve.strain + sign * errors[0], transverse=beside)
        side = material_properties(moved, found.settings, window)
        sides.append(side.values | {NECKING: side.necking})
    changes = {}
    for name, value in (found.values | {NECKING: found.necking}).items():
        ahead, behind = (side[name].value if name in side else None for side in sides)
        if value.value is not None and value.std is not None and ahead is not None and behind is not None:
            changes[name] = 0.5 * abs(ahead - behind)
    return changes
