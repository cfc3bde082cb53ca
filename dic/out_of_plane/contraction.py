"""The shift towards the camera that the lateral contraction of an elastic specimen shows.

A shift adds the same strain s to the strain along the load and to the strain across it. For an elastic
specimen with Poisson's ratio ν, the measured strains are m1 = e + s and m2 = -ν e + s, so that s = (ν m1 +
m2)/(1 + ν). Poisson's ratio is not known well enough to correct the shift. But a large s contradicts the
expected shift, and the standard deviation must then contain s.
"""

from dataclasses import dataclass
from math import hypot, sqrt

import numpy as np

from dic.out_of_plane.thinning import RATIO_STD, elastic_part
from dic.typing import Float

_ELASTIC = 0.005
"""Above this strain most metals have yielded, and the contraction does not show the shift."""

_PLASTIC_RATIO = 0.5

_CLEAR = 4.0
"""The contraction contradicts an expected shift beyond so many standard deviations.

A test has many images, so a smaller number would often find a fault by chance.
"""


@dataclass(frozen=True)
class ShownShift:
    """The shift that the contraction shows, and whether it contradicts the expected shift."""

    shift_mm: float
    std_mm: float
    """Standard deviation of `shift_mm` by Poisson's ratio and all errors of the strains but the shift."""
    contradicts: bool


def shown_shift(
    gradient: Float, covariance: Float, poisson_ratio: float, expected_mm: float, height_mm: float
) -> ShownShift | None:
    """Return the shift that the contraction shows; None if the specimen may have yielded.

    Parameters
    ----------
    gradient : ndarray, shape (2, 2)
        Displacement gradient, corrected for the expected shift.
    covariance : ndarray, shape (4, 4)
        Covariance of the gradient's elements by all causes except the shift.
    poisson_ratio : float
        Poisson's ratio of the specimen.
    expected_mm : float
        Standard deviation of the expected shift.
    height_mm : float
        Height of the camera above the specimen's plane.
    """
    # A rotation is no strain, so the stretches are used, of which the larger one comes first.
    now, stretches, before = np.linalg.svd(gradient + np.eye(2))
    strains = stretches - 1.0
    rows = np.array([np.outer(now[:, k], before[k]).ravel() for k in (0, 1)])
    found = []
    # A stretched specimen has its load along the larger strain, and a compressed one along the smaller.
    for along in (0, 1):
        common, std, elastic = _common(strains, rows, covariance, poisson_ratio, along)
        if elastic <= _ELASTIC:
            limit = _CLEAR * hypot(std, expected_mm / height_mm)
            found.append(ShownShift(height_mm * common, height_mm * std, abs(common) > limit))
    return min(found, key=lambda each: each.contradicts) if found else None


def _common(
    strains: Float, rows: Float, covariance: Float, nu: float, along: int
) -> tuple[float, float, float]:
    """Return s, its standard deviation, and the strain along the load; `along` is its index.

    `rows`, shape (2, 4): derivatives of the principal strains with respect to the gradient's elements.
    """
    across = 1 - along
    common = float(nu * strains[along] + strains[across]) / (1.0 + nu)
    elastic = float(strains[along]) - common
    weights = (nu * rows[along] + rows[across]) / (1.0 + nu)
    # Plastic flow contracts the specimen more than Poisson's ratio does.
    yielded, part, part_std = elastic_part(abs(elastic))
    plastic = sqrt(yielded) * hypot(abs(elastic) - part, part_std) * (_PLASTIC_RATIO - nu)
    by_ratio = hypot(RATIO_STD * elastic, plastic) / (1.0 + nu)
    return common, hypot(sqrt(float(weights @ covariance @ weights)), by_ratio), abs(elastic)
