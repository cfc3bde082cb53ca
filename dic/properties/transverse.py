"""Poisson's ratio and the plastic strain ratio r, from strain across the specimen."""

import numpy as np

from dic.properties.elastic import Elastic
from dic.properties.record import Record
from dic.properties.value import PropertyValue, missing, root_sum
from dic.properties.windows import fit_line, std_of_slope
from dic.typing import Float

NU_RULE = "slope of transverse strain over slope of axial strain, both against the load (rule of ASTM E132)"
R_RULE = "regression of true plastic strain of width against length, constant volume (rule of ISO 10113)"
LEAST_POINTS, LEAST_SHARE = 5, 0.5
"""Least number and share of the points that must have a transverse strain."""
NO_TRANSVERSE = "no transverse strain was given"


def poisson_ratio(record: Record, elastic: Elastic) -> PropertyValue:
    """Return Poisson's ratio in the window of the elastic slope.

    The area and a relative error of all loads do not change the ratio. A relative error that is equal in both
    strains does not change it either.
    """
    if record.curve.transverse is None:
        return missing("1", NU_RULE, NO_TRANSVERSE)
    line = elastic.line
    part = slice(line.first, line.stop)
    stress, axial, across = _known(record.stress[part], record.strain[part], record.curve.transverse[part])
    if len(across) < LEAST_POINTS or len(across) < LEAST_SHARE * (line.stop - line.first):
        return missing("1", NU_RULE, _too_few(len(across), line.stop - line.first, "the window of E"))
    lines = [fit_line(stress, values, 0, len(stress)) for values in (axial, across)]
    shares = [std_of_slope(stress, values, each) for values, each in zip((axial, across), lines, strict=True)]
    ratio = -lines[1].slope / lines[0].slope
    halves = [_ratio(stress[half], axial[half], across[half]) for half in _halves(len(stress))]
    spread = abs(halves[1] - halves[0]) / 4.0
    std = root_sum(ratio * shares[0] / lines[0].slope, shares[1] / lines[0].slope, spread)
    flags = [flag for flag in elastic.flags if flag.startswith(("few", "hysteresis", "ladder"))]
    if not 0.0 < ratio < 0.5:
        flags.append("range: Poisson's ratio of a metal lies between 0 and 0.5")
    return PropertyValue(ratio, std, "1", NU_RULE, elastic.window, tuple(flags))


def strain_ratio(record: Record, elastic: Elastic, part: slice, window: dict[str, object]) -> PropertyValue:
    """Return the plastic strain ratio r from a part of the record with uniform plastic strain."""
    if record.curve.transverse is None:
        return missing("1", R_RULE, NO_TRANSVERSE)
    stress, along, across = _known(
        record.strained_stress[part], record.strain[part] - elastic.foot, record.curve.transverse[part]
    )
    whole = part.stop - part.start
    if len(across) < max(LEAST_POINTS, LEAST_SHARE * whole):
        return missing("1", R_RULE, _too_few(len(across), whole, "the range of hardening"))
    nu = poisson_ratio(record, elastic).value or 0.3
    # The zero of the transverse strain is the value at stress 0 of a line fitted in the elastic window.
    inside = slice(elastic.line.first, elastic.line.stop)
    low, _, zeros = _known(record.stress[inside], record.strain[inside], record.curve.transverse[inside])
    if len(zeros) < LEAST_POINTS:
        number = elastic.line.stop - elastic.line.first
        return missing("1", R_RULE, _too_few(len(zeros), number, "the window of E"))
    across = across - fit_line(low, zeros, 0, len(zeros)).intercept
    elastic_part = stress * (1.0 + along) / elastic.line.slope
    length = np.log1p(along) - elastic_part
    width = np.log1p(across) + nu * elastic_part
    line = fit_line(length, width, 0, len(length))
    share = -line.slope
    if not 0.0 < share < 1.0:
        return missing(
            "1", R_RULE, f"the width changes by {share:.2f} of the length, so the thickness would grow"
        )
    std = std_of_slope(length, width, line) / (1.0 - share) ** 2
    halves = [
        -fit_line(length[half], width[half], 0, len(length[half])).slope for half in _halves(len(length))
    ]
    spread = abs(halves[1] - halves[0]) / 4.0 / (1.0 - share) ** 2
    return PropertyValue(share / (1.0 - share), root_sum(std, spread), "1", R_RULE, window)


def _known(stress: Float, axial: Float, across: Float) -> tuple[Float, Float, Float]:
    """Return stress, axial and transverse strain of the points that have a transverse strain."""
    known = np.isfinite(across)
    return stress[known], axial[known], across[known]


def _too_few(count: int, whole: int, where: str) -> str:
    return f"few points: {count} of {whole} in {where} have a transverse strain"


def _halves(count: int) -> tuple[slice, slice]:
    return slice(0, count // 2 + 1), slice(count // 2 - 1, count)


def _ratio(stress: Float, axial: Float, across: Float) -> float:
    lines = [fit_line(stress, values, 0, len(stress)) for values in (axial, across)]
    return -lines[1].slope / lines[0].slope
