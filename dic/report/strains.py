"""Strains and slopes of several images as arrays, in the units of the report. Missing values are NaN."""

from collections.abc import Sequence

import numpy as np

from dic.out_of_plane.correction import Correction
from dic.strain.strain import MeanStrain
from dic.typing import Float

MICRO = 1e6
COMPONENTS = ("εxx", "εyy", "εxy")
XX, YY = 0, 1
"""Indices of εxx and εyy in `COMPONENTS`."""

_NAMES = ("exx", "eyy", "exy")


def strains(means: Sequence[MeanStrain | None]) -> Float:
    """Return the components εxx, εyy, εxy of k mean strains as an array in µε, shape (k, 3)."""
    return MICRO * _columns(means, _NAMES)


def strain_stds(means: Sequence[MeanStrain | None]) -> Float:
    """Return the standard deviations of εxx, εyy, εxy of k mean strains in µε, shape (k, 3)."""
    return MICRO * _columns(means, [f"{name}_std" for name in _NAMES])


def plane_slopes(corrections: Sequence[Correction]) -> tuple[Float, Float]:
    """Return the slopes of the specimen's plane along X and Y, degrees, and their standard deviations.

    Both arrays have the shape (k, 2) for k corrections. The values are NaN where a correction found no plane.
    """
    slopes, stds = (np.full((len(corrections), 2), np.nan) for _ in range(2))
    for k, found in enumerate(corrections):
        if found.declined is None and found.after is not None and found.after_std is not None:
            slopes[k] = np.degrees(np.arctan([found.after.slope_x, found.after.slope_y]))
            stds[k] = np.degrees(found.after_std[:2])
    return slopes, stds


def _columns(means: Sequence[MeanStrain | None], names: Sequence[str]) -> Float:
    rows = [[np.nan if mean is None else getattr(mean, name) for name in names] for mean in means]
    return np.array(rows, np.float64).reshape(-1, len(names))
