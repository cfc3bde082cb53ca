"""The two cameras of several that see the surface from the most different directions."""

from collections.abc import Mapping
from itertools import combinations

import numpy as np

from dic.calibration.calibration import Calibration


def most_different(calibrations: Mapping[str, Calibration | None]) -> tuple[str, str] | None:
    """Return the names of the two cameras with the most different directions, the more oblique one first.

    Return None if fewer than two cameras have a pinhole model.
    """
    aside = [
        (each.pinhole.centre_mm[:2] / each.pinhole.centre_mm[2], name)
        for name, each in calibrations.items()
        if each is not None and each.pinhole is not None
    ]
    if len(aside) < 2:
        return None
    # Two cameras measure the height of a point by parallax. The parallax is proportional to the difference of
    # the tangents of their viewing angles.
    pair = max(combinations(aside, 2), key=lambda both: float(np.linalg.norm(both[0][0] - both[1][0])))
    second, first = sorted(pair, key=lambda camera: float(np.linalg.norm(camera[0])))
    return first[1], second[1]
