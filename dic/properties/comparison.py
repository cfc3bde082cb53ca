"""Compare the elastic slope with the slopes in two bands of stress, because a difference reveals slack."""

from dataclasses import replace

import numpy as np

from dic.properties.elastic import Elastic
from dic.properties.record import Record
from dic.properties.settings import PropertySettings
from dic.properties.windows import fit_line
from dic.properties.yielding import Plateau, offset_strength

USUAL_BAND, USUAL_DIFFERENCE = (0.1, 0.4), 0.02
"""Band of stress for the elastic slope in ISO 6892-1, as shares of the yield strength, and the largest
relative difference of the slope in this band.
"""
UPPER_BAND, STEEPER, LESS_STEEP = (0.4, 0.6), 0.02, -0.06
"""Band of stress above the usual one, with the largest and the smallest relative difference of the slope."""
LEAST_POINTS = 5


def compared(
    record: Record, elastic: Elastic, settings: PropertySettings, plateau: Plateau | None
) -> Elastic:
    """Return the elastic line, with a flag for each band of stress whose slope differs too much."""
    if plateau is not None:
        yield_mpa: float | None = float(record.stress[plateau.upper])
    else:
        yield_mpa = offset_strength(record, elastic, settings, 0.2, None).value
    if yield_mpa is None:
        return elastic
    flags = []
    for band, least, most in (
        (USUAL_BAND, -USUAL_DIFFERENCE, USUAL_DIFFERENCE),
        (UPPER_BAND, LESS_STEEP, STEEPER),
    ):
        slope = _slope(record, band[0] * yield_mpa, band[1] * yield_mpa)
        share = 0.0 if slope is None else slope / elastic.line.slope - 1.0
        if slope is not None and not least <= share <= most:
            flags.append(
                f"slack: between {band[0]:.0%} and {band[1]:.0%} of the yield strength the slope is"
                f" {slope / 1e3:.1f} GPa, {share:+.1%} from the value"
            )
    return replace(elastic, flags=(*elastic.flags, *flags))


def _slope(record: Record, low_mpa: float, high_mpa: float) -> float | None:
    """Return the slope between two stresses during the first loading; None if there are too few points."""
    first, stop = record.between(low_mpa, high_mpa)
    if stop - first < LEAST_POINTS or np.ptp(record.strain[first:stop]) == 0.0:
        return None
    return fit_line(record.strain, record.strained_stress, first, stop).slope
