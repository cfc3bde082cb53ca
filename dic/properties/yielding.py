"""Yield strengths: offset yield strength, upper and lower yield strength, yield point extension.

The definitions follow ISO 6892-1:2019 (3.10, 11 to 14 and A.3).
"""

from dataclasses import dataclass

import numpy as np

from dic.properties.crossing import Crossing, Noise, crossing
from dic.properties.elastic import Elastic
from dic.properties.record import Record
from dic.properties.settings import PropertySettings
from dic.properties.value import PropertyValue, excess_of_extreme, missing, root_sum
from dic.properties.windows import fit_line
from dic.typing import Float

DROP_SHARE, QUIET_STRAIN = 0.005, 5e-4
"""After the upper yield strength the stress must fall by this share, and stay lower over this strain."""
YIELD_STRAIN = 0.02
"""The upper yield strength must occur below this plastic strain; later drops are serrations or necking."""
REBOUND_SHARE = 0.001
FLAT_TIMES = 4.0
"""Points within this number of standard deviations of noise from an extreme may be at its level."""
HARDENING_STRAIN = 0.002
"""Width, in strain, of the windows in which the steepest slope of hardening is searched."""
OFFSET_RULE = "intersection with the elastic line shifted by {:g} %, after correction of the curve's foot"
REH_RULE = "first maximum that is followed by a drop of 0.5 %"
REL_RULE = "lowest stress during yielding, without the first transient"
AE_RULE = "from ReH to the intersection of the last minimum's level with the steepest line of hardening"


@dataclass(frozen=True)
class Plateau:
    """The points of a record that show discontinuous yielding."""

    upper: int
    """Index of the point of the upper yield strength."""
    lower: int
    """Index of the point of the lower yield strength."""
    last: int
    """Index of the last minimum of the stress before uniform hardening."""


def offset_strength(
    record: Record,
    elastic: Elastic,
    settings: PropertySettings,
    offset_percent: float,
    plateau: Plateau | None,
) -> PropertyValue:
    """Return the offset yield strength: the stress at which the plastic strain reaches the offset."""
    rule, offset = OFFSET_RULE.format(offset_percent), offset_percent / 100.0
    stress, strain = record.strained_stress, record.strain
    noise = _noise(record)
    at = _crossing(strain, stress, elastic, offset, 0.0, noise)
    if at is None:
        reason = "the record of strain ends before the shifted elastic line"
        return missing("MPa", rule, " ".join((reason, *filter(None, [record.end_reason]))))
    turned = [_crossing(strain, stress, elastic, offset, by * elastic.std_mpa, noise) for by in (-1.0, 1.0)]
    by_line = max((abs(side.stress_mpa - at.stress_mpa) for side in turned if side is not None), default=0.0)
    # If all measured strains are too large by the share p, the true offset is at the measured offset (1 + p).
    shifted = _crossing(strain, stress, elastic, offset * (1.0 + settings.strain_share), 0.0, noise)
    by_strain = abs(shifted.stress_mpa - at.stress_mpa) if shifted is not None else 0.0
    common = at.stress_mpa * settings.stress_share
    std = root_sum(common, by_line, by_strain, at.std_mpa)
    flags = [*_doubt(elastic)]
    if plateau is not None and at.point >= plateau.upper:
        flags.append(
            "plateau: the intersection lies on the yield plateau; ReH and ReL describe this yielding"
        )
    if record.passed(at.point - 1, at.point + 1)[1] > -np.inf:
        flags.append("gap: images beside the intersection have no strain")
    window = {"strain_percent": 100 * (offset + at.stress_mpa / elastic.line.slope), "point": at.point}
    return PropertyValue(at.stress_mpa, std, "MPa", rule, window, tuple(flags))


def _crossing(
    strain: Float, stress: Float, elastic: Elastic, offset: float, turn_mpa: float, noise: Noise
) -> Crossing | None:
    slope, foot = elastic.turned(turn_mpa)
    return crossing(strain - foot - offset, stress, slope, elastic.line.stop, noise)


def find_plateau(record: Record, elastic: Elastic) -> Plateau | str:
    """Find the plateau of discontinuous yielding, or return the reason why there is none."""
    stress, strain = record.strained_stress, record.strain - elastic.foot
    plastic = strain - stress / elastic.line.slope
    begin = elastic.line.stop
    early = int(np.argmax(plastic > YIELD_STRAIN)) if (plastic > YIELD_STRAIN).any() else len(stress)
    if early <= begin:
        return "the record has no points between the elastic part and 2 % of plastic strain"
    highest = np.maximum.accumulate(stress)
    dropped = stress < (1.0 - DROP_SHARE) * highest
    dropped[:begin] = False
    drops = np.flatnonzero(dropped & (highest > elastic.window["stress_mpa"][1]))
    upper = int(np.argmax(stress[: drops[0] + 1])) if drops.size else len(stress)
    if upper >= early:
        return "the stress does not drop by 0.5 % at the beginning of yielding"
    again = upper + 1 + np.flatnonzero(stress[upper + 1 :] > stress[upper])
    if not again.size:
        return "the stress never exceeds its first maximum again: this is Rm, or the record is too short"
    if strain[again[0]] - strain[upper] < QUIET_STRAIN:
        return "the drop after the first maximum is shorter than 0.05 % of strain"
    return _minima(record, upper, int(again[0]))


def _minima(record: Record, upper: int, again: int) -> Plateau:
    """Find the lowest stress of a plateau after the initial transient, and the last minimum."""
    stress = record.strained_stress[: again + 1]
    rebound = max(REBOUND_SHARE * float(stress[upper]), 6.0 * _local_noise(record))
    falling = np.minimum.accumulate(stress[upper:])
    risen = np.flatnonzero(stress[upper:] > falling + rebound)
    end_of_transient = upper + _fallen_again(stress[upper:], int(risen[0]), rebound) if risen.size else upper
    # Go backwards from the end: the stress falls to the last minimum and then rises.
    back = stress[upper:][::-1]
    rises = back > np.minimum.accumulate(back) + rebound
    tail = len(stress) - int(np.argmax(rises)) if rises.any() else upper
    last = tail + int(np.argmin(stress[tail:]))
    whole = upper + int(np.argmin(stress[upper:]))
    # A single minimum between ReH and hardening is ReL itself, not a transient.
    lower = (
        whole if end_of_transient == upper else end_of_transient + int(np.argmin(stress[end_of_transient:]))
    )
    return Plateau(upper, lower, last)


def _fallen_again(stress: Float, rising: int, rebound: float) -> int:
    """Return where the stress falls after its rise from the first minimum; 0 if it does not fall again."""
    highest = np.maximum.accumulate(stress[rising:])
    fallen = np.flatnonzero(stress[rising:] < highest - rebound)
    return rising + int(fallen[0]) if fallen.size else 0


def upper_yield(
    record: Record, elastic: Elastic, settings: PropertySettings, plateau: Plateau
) -> PropertyValue:
    """Return the upper yield strength ReH."""
    stress = record.strained_stress
    if record.passed(0, plateau.last + 1)[1] > stress[plateau.upper]:
        return missing(
            "MPa", REH_RULE, "the image of the largest stress at the beginning of yielding has no strain"
        )
    rest = stress[: plateau.last + 1]
    near = rest >= stress[plateau.upper] - FLAT_TIMES * _local_noise(record)
    return _yield_value(record, elastic, settings, plateau.upper, REH_RULE, int(np.count_nonzero(near)))


def lower_yield(
    record: Record, elastic: Elastic, settings: PropertySettings, plateau: Plateau
) -> PropertyValue:
    """Return the lower yield strength ReL."""
    stress = record.strained_stress
    if record.passed(plateau.upper, plateau.last + 1)[0] < stress[plateau.lower]:
        return missing("MPa", REL_RULE, "the image of the lowest stress during yielding has no strain")
    rest = stress[plateau.upper : plateau.last + 1]
    near = rest <= stress[plateau.lower] + FLAT_TIMES * _local_noise(record)
    return _yield_value(record, elastic, settings, plateau.lower, REL_RULE, int(np.count_nonzero(near)))


def yield_extension(
    record: Record, elastic: Elastic, settings: PropertySettings, plateau: Plateau
) -> PropertyValue:
    """Return the yield point extension Ae: the strain from ReH to the beginning of uniform hardening."""
    stress, strain = record.strained_stress, record.strain
    best = None
    for first in range(plateau.last, len(stress) - 1):
        if strain[first] > strain[plateau.last] + 0.02:
            break
        stop = int(np.searchsorted(strain[first:], strain[first] + HARDENING_STRAIN)) + first
        if stop - first >= 5 and stop < len(stress) and np.ptp(strain[first:stop]) > 0.0:
            line = fit_line(strain, stress, first, stop)
            best = line if best is None or line.slope > best.slope else best
    if best is None or best.slope <= 0.0:
        return missing("%", AE_RULE, "the record of strain ends before hardening is seen")
    level = float(stress[plateau.last])
    end = (level - best.intercept) / best.slope
    extension = end - float(strain[plateau.upper])
    # The flat top of ReH and the curved start of hardening are the largest uncertainties.
    flat = np.flatnonzero(stress[: plateau.lower + 1] > stress[plateau.upper] - 2.0 * _local_noise(record))
    width = float(strain[flat[-1]] - strain[flat[0]]) if flat.size else 0.0
    reach = abs(end - float(strain[plateau.last]))
    std = root_sum(width / np.sqrt(12.0), reach / np.sqrt(12.0), extension * settings.strain_share)
    window = {
        "strain_percent": [100 * (float(strain[plateau.upper]) - elastic.foot), 100 * (end - elastic.foot)]
    }
    return PropertyValue(100 * extension, 100 * std, "%", AE_RULE, window)


def _yield_value(
    record: Record, elastic: Elastic, settings: PropertySettings, at: int, rule: str, near: int
) -> PropertyValue:
    stress, noise = float(record.stress[at]), _local_noise(record)
    # The extreme of `near` noisy values at one level differs from this level.
    std = root_sum(stress * settings.stress_share, noise, excess_of_extreme(noise, near))
    window = {"strain_percent": 100 * float(record.strain[at] - elastic.foot), "point": at}
    return PropertyValue(stress, std, "MPa", rule, window)


def _noise(record: Record) -> Noise:
    shown, stated = record.noise(record.strained_stress), _local_noise(record)
    alike = max(record.alike(values) for values in (record.strain, record.strained_stress))
    shared = float(np.sqrt(max(stated**2 - shown**2, 0.0)))
    return Noise(record.noise(record.strain), shown, shared, min(alike, 0.98))


def _local_noise(record: Record) -> float:
    return record.stress_noise(record.strained_stress)


def _doubt(elastic: Elastic) -> list[str]:
    """Return one flag that names the objections to the elastic line; none without objections."""
    words = sorted({flag.partition(":")[0] for flag in elastic.flags})
    return [f"elastic line: {', '.join(words)}"] if words else []
