"""Tensile strength and elongations, after ISO 6892-1:2019 (3.6, 3.10, 15 to 20)."""

from collections.abc import Mapping

import numpy as np

from dic.properties.elastic import Elastic
from dic.properties.record import Record
from dic.properties.settings import PropertySettings
from dic.properties.value import PropertyValue, excess_of_extreme, missing, root_sum
from dic.properties.yielding import Plateau

FLAT_TIMES, HUMP_TIMES, HUMP_SHARE = 4.0, 8.0, 0.005
"""Limits of the difference from the largest stress. A point may be at the top level if it is at most
`FLAT_TIMES` standard deviations of the noise below. A valley separates two maxima if it is more than
`HUMP_TIMES` standard deviations and more than `HUMP_SHARE` of the stress below.
"""
RM_RULE = "largest stress after yielding"
AGT_RULE = "strain at Rm, the middle of a flat maximum, after correction of the curve's foot"
AG_RULE = "Agt minus Rm over the elastic slope"
A_RULE = "strain at the break minus stress over the elastic slope, after correction of the curve's foot"


def strength_point(record: Record, plateau: Plateau | None) -> int:
    """Return the index of the largest stress; if there is a yield plateau, of the largest stress after it."""
    begin = begin_of(plateau)
    return begin + int(np.argmax(record.stress[begin:]))


def begin_of(plateau: Plateau | None) -> int:
    """Return the index of the last point of the yield plateau; 0 if there is no plateau."""
    return plateau.last if plateau is not None else 0


def why_no_strain(record: Record, at: int, plateau: Plateau | None = None) -> str:
    """Return the reason why the strain at the largest stress is not known; "" if it is known.

    `at`: index of the largest stress, from `strength_point`.
    """
    if _largest_without_strain(record, plateau) > record.stress[at]:
        return "the image of the largest load has no strain"
    if at >= record.end:
        return f"{record.end_reason or 'the strain ends before Rm'}; Rm comes later"
    return ""


def _largest_without_strain(record: Record, plateau: Plateau | None) -> float:
    """Return the largest stress, MPa, of the images without strain after yielding."""
    return record.passed(begin_of(plateau), len(record.stress))[1]


def tensile_strength(
    record: Record, settings: PropertySettings, at: int, plateau: Plateau | None = None
) -> PropertyValue:
    """Return the tensile strength Rm, which is computed without any strain."""
    stress = float(record.stress[at])
    noise = record.stress_noise(record.stress)
    without_strain = _largest_without_strain(record, plateau)
    count = np.count_nonzero(record.stress[begin_of(plateau) :] >= stress - FLAT_TIMES * noise)
    window, flags = {"point": at}, []
    if without_strain > stress:
        # No point of the curve has this stress.
        stress, window = without_strain, {}
        flags.append("gap: the image of the largest load has no strain")
    elif at >= len(record.stress) - 2:
        flags.append("end: the largest stress is the last one, so the record may end before Rm")
    # On a flat top, the largest of many noisy values is larger than the true stress.
    std = root_sum(stress * settings.stress_share, noise, excess_of_extreme(noise, int(count)))
    return PropertyValue(stress, std, "MPa", RM_RULE, window, tuple(flags))


def uniform_elongations(
    record: Record, elastic: Elastic, settings: PropertySettings, at: int, plateau: Plateau | None = None
) -> tuple[PropertyValue, PropertyValue]:
    """Return the total and the plastic extension at the largest force, Agt and Ag."""
    reason = why_no_strain(record, at, plateau)
    if not reason and at >= len(record.stress) - 2:
        reason = "the largest stress is the last one, so the record may end before Rm"
    if reason:
        return missing("%", AGT_RULE, reason), missing("%", AG_RULE, reason)
    stress = record.strained_stress
    noise = record.stress_noise(stress)
    begin = begin_of(plateau)
    flat = begin + np.flatnonzero(stress[begin:] >= stress[at] - 2.0 * noise)
    # If the stress falls far between two points, they belong to two different maxima.
    valley = stress < stress[at] - max(HUMP_TIMES * noise, HUMP_SHARE * stress[at])
    hump = np.cumsum(valley)[flat]
    if (hump != hump[flat == at]).any():
        reason = "the record has two maxima whose stresses do not differ by more than the noise"
        return missing("%", AGT_RULE, reason), missing("%", AG_RULE, reason)
    strain = record.strain[flat]
    low, high = float(strain.min()) - elastic.foot, float(strain.max()) - elastic.foot
    total = 0.5 * (low + high)
    spread = (high - low) / np.sqrt(12.0)
    std = root_sum(spread, total * settings.strain_share, record.noise(record.strain))
    window = {"strain_percent": [100 * low, 100 * high]}
    agt = PropertyValue(100 * total, 100 * std, "%", AGT_RULE, window)
    return agt, _without_elastic(total, std, float(stress[at]), elastic, AG_RULE, window)


def elongation_at_break(record: Record, elastic: Elastic, settings: PropertySettings) -> PropertyValue:
    """Return the elongation A after fracture, from the last strain before the break."""
    at = record.break_point
    if at is None:
        return missing("%", A_RULE, "the record does not show the break")
    if at >= record.end:
        return missing("%", A_RULE, record.end_reason or "the strain ends before the break")
    total = float(record.strain[at]) - elastic.foot
    std = root_sum(total * settings.strain_share, record.noise(record.strain))
    window = {"strain_percent": 100 * total, "point": at}
    return _without_elastic(total, std, float(record.stress[at]), elastic, A_RULE, window)


def _without_elastic(
    total: float,
    std: float,
    stress: float,
    elastic: Elastic,
    rule: str,
    window: Mapping[str, object],
) -> PropertyValue:
    part = stress / elastic.line.slope
    # A common relative error of all stresses changes stress and slope alike, so the elastic strain stays the
    # same.
    std = root_sum(std, part * elastic.std_mpa / elastic.line.slope)
    return PropertyValue(100 * (total - part), 100 * std, "%", rule, dict(window))
