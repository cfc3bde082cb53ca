"""Plastic anisotropy of a sheet from tests in three directions."""

from collections.abc import Mapping

from dic.errors import CurveError
from dic.properties.value import PropertyValue, missing, root_sum

DIRECTIONS_DEG = (0, 45, 90)
MEAN_RULE = "(r0 + 2 r45 + r90) / 4 (rule of ISO 10113)"
DELTA_RULE = "(r0 + r90 - 2 r45) / 2 (rule of ISO 10113)"


def planar_anisotropy(ratios: Mapping[int, PropertyValue]) -> dict[str, PropertyValue]:
    """Return the mean strain ratio r̄ and the planar anisotropy Δr of a sheet.

    Parameters
    ----------
    ratios : mapping of int to PropertyValue
        The strain ratio r of tests at 0°, 45° and 90° to the rolling direction, such as
        ``properties.values["r"]``. The errors of the three tests are taken to be independent.

    Returns
    -------
    dict of str to PropertyValue
        "r_mean" and "delta_r". Their values are None if one of the three ratios is missing.

    Raises
    ------
    CurveError
        If the directions are not 0, 45 and 90.
    """
    if sorted(ratios) != list(DIRECTIONS_DEG):
        expected, remedy = "tests at 0°, 45° and 90°", "give one strain ratio for each of these directions"
        raise CurveError("anisotropy", "directions", expected, str(sorted(ratios)), remedy)
    return {
        "r_mean": _sum(ratios, (0.25, 0.5, 0.25), MEAN_RULE),
        "delta_r": _sum(ratios, (0.5, -1.0, 0.5), DELTA_RULE),
    }


def _sum(
    ratios: Mapping[int, PropertyValue], weights: tuple[float, float, float], rule: str
) -> PropertyValue:
    """Return the weighted sum of the strain ratios at 0°, 45° and 90°, with its standard deviation."""
    value, parts, flags = 0.0, [], []
    for direction, weight in zip(DIRECTIONS_DEG, weights, strict=True):
        ratio = ratios[direction]
        if ratio.value is None:
            return missing("1", rule, f"no strain ratio at {direction}°: {'; '.join(ratio.flags)}")
        value += weight * ratio.value
        parts.append(None if ratio.std is None else weight * ratio.std)
        flags += [f"at {direction}°, {flag}" for flag in ratio.flags]
    known = [part for part in parts if part is not None]
    std = root_sum(*known) if len(known) == len(parts) else None
    return PropertyValue(value, std, "1", rule, flags=tuple(flags))
