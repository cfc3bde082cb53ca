"""The effect of an error of strain that all points share: of the calibration, and of motion out of the plane.

Such an error does not average out over the points of a curve. In the reference image the strain is exactly
zero and has no error, so the error grows during the test. This module assumes that the error grows in
proportion to the load up to the end of the elastic window, where it reaches its stated standard deviation. No
other growth changes the elastic slope more.
"""

from dataclasses import replace

import numpy as np

from dic.properties.properties import Properties, material_properties
from dic.typing import Float


def with_shared_error(found: Properties, shared_std: Float) -> Properties:
    """Return properties whose standard deviations contain an error of strain that all points share.

    Each property is computed again with strain that has this error, once added and once taken away. Half of
    the difference is the error of the property.

    Parameters
    ----------
    found : Properties
    shared_std : ndarray, shape (n,)
        Standard deviation of the error at each point of the curve.
    """
    elastic, record = found.elastic, found.record
    if elastic is None or not np.isfinite(shared_std).all():
        return found
    curve, end = record.curve, elastic.line.stop
    error = np.array(shared_std, np.float64)
    error[:end] = error[end - 1] * curve.load_n[:end] / curve.load_n[end - 1]
    # Both curves are fitted between the same stresses, so that the choice of a window does not change the
    # result.
    low, high = elastic.window["stress_mpa"]
    settings = replace(found.settings, window_mpa=(low, high))
    sides = [
        material_properties(replace(curve, strain=curve.strain + sign * error), settings).values
        for sign in (1.0, -1.0)
    ]
    values, parts = {}, {}
    for name, value in found.values.items():
        ahead, behind = (side[name].value if name in side else None for side in sides)
        values[name] = value
        if value.value is None or value.std is None or ahead is None or behind is None:
            continue
        parts[name] = 0.5 * abs(ahead - behind)
        values[name] = replace(value, std=float(np.hypot(value.std, parts[name])))
    return replace(found, values=values, strain_parts=parts)
