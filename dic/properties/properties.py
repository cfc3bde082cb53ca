"""All material properties of a tensile test, from its curve."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from math import inf
from typing import Any

from dic.errors import CurveError, require_kind
from dic.properties.comparison import compared
from dic.properties.curve import Curve
from dic.properties.elastic import Elastic, elastic_line
from dic.properties.hardening import (
    N_RULE,
    NECK_RULE,
    TrueCurve,
    hardening_exponent,
    hardening_laws,
    hardening_range,
    necking,
    true_curve,
)
from dic.properties.record import Record, record_of
from dic.properties.settings import STRAIN, PropertySettings
from dic.properties.strength import (
    A_RULE,
    AG_RULE,
    AGT_RULE,
    elongation_at_break,
    strength_point,
    tensile_strength,
    uniform_elongations,
)
from dic.properties.transverse import NO_TRANSVERSE, NU_RULE, R_RULE, poisson_ratio, strain_ratio
from dic.properties.value import PropertyValue, missing
from dic.properties.yielding import (
    AE_RULE,
    OFFSET_RULE,
    REH_RULE,
    REL_RULE,
    Plateau,
    find_plateau,
    lower_yield,
    offset_strength,
    upper_yield,
    yield_extension,
)

_MOST_GPA, _MOST_MPA = 1250.0, 50e3
"""Largest modulus and stress of any material: those of diamond and of the strongest whiskers."""
_LEAST_SHARE = 0.1
"""Smallest share of a standard deviation that is told."""


@dataclass(frozen=True)
class Properties:
    """The properties of a material, from one tensile test.

    Attributes
    ----------
    record : Record
        Stress and strain of the test.
    settings : PropertySettings
    elastic : Elastic or None
        The elastic line; None if there is none.
    plateau : Plateau or None
        Discontinuous yielding; None if the material yields continuously.
    values : dict of str to PropertyValue
        E_gpa, nu, Rp02_mpa, ReH_mpa, ReL_mpa, Ae_percent, Rm_mpa, Ag_percent, Agt_percent, A_percent, r, n.
    necking : PropertyValue
        True strain at which necking begins.
    laws : dict
        Laws of hardening fitted to the true curve.
    true : TrueCurve or None
    strain_parts : mapping of str to float, or None
        The part of each standard deviation that an error of strain common to all points causes, keyed by the
        name of the value; None if no such error was given.
    join_parts : mapping of str to mapping of str to float, or None
        For each value, the parts of its standard deviation that the offset and the rate of the machine's
        clock cause, "offset" and "clock_rate", and with their correlation "both"; None without a join by
        time.
    delay_parts : mapping of str to float, or None
        For each value, the part of its standard deviation that the delay of the load and the times of the
        images cause; None if the load comes from a table.
    """

    record: Record
    settings: PropertySettings
    elastic: Elastic | None
    plateau: Plateau | None
    values: dict[str, PropertyValue]
    necking: PropertyValue
    laws: dict[str, dict[str, Any]]
    true: TrueCurve | None
    strain_parts: Mapping[str, float] | None = None
    join_parts: Mapping[str, Mapping[str, float]] | None = None
    delay_parts: Mapping[str, float] | None = None

    @cached_property
    def flags(self) -> list[str]:
        """Warnings about the whole record, not about a single property."""
        return [self.record.end_reason] if self.record.end_reason else []

    @property
    def time_texts(self) -> list[str]:
        """The parts of the standard deviations that errors of time cause, in words; empty without any."""
        clock, delay = self.join_parts or {}, self.delay_parts or {}
        told = self._told({name: part["both"] for name, part in clock.items()})
        by_clock = [self._part(name, clock[name]["offset"], clock[name]["clock_rate"]) for name in told]
        by_delay = [self._part(name, delay[name]) for name in self._told(delay)]
        causes = {"offset and rate of the machine's clock": by_clock, "the delay of the load": by_delay}
        return [f"± by {cause}: {', '.join(texts)}" for cause, texts in causes.items() if texts]

    def _told(self, parts: Mapping[str, float]) -> list[str]:
        """Return the names of the values of which a part is a notable share of the standard deviation."""
        stds = {name: value.std for name, value in self.values.items() if value.std}
        return [name for name, part in parts.items() if part > _LEAST_SHARE * stds.get(name, inf)]

    def _part(self, name: str, *parts: float) -> str:
        unit = self.values[name].unit
        numbers = " and ".join(f"{part:.2g}" for part in parts)
        return f"{name.partition('_')[0]} {numbers}{'' if unit == '1' else f' {unit}'}"

    @property
    def not_counted(self) -> list[str]:
        """Names of the uncertainties that are not known."""
        names = self.settings.not_counted
        return [name for name in names if self.strain_parts is None or name != STRAIN]

    def as_dict(self) -> dict[str, Any]:
        """Return everything for JSON."""
        return {
            **{name: value.as_dict() for name, value in self.values.items()},
            "necking": self.necking.as_dict(),
            "fits": self.laws,
            "area_mm2": self.settings.area_mm2,
            "not_counted": self.not_counted,
            **({} if self.strain_parts is None else {"std_by_strain": dict(self.strain_parts)}),
            **({} if self.join_parts is None else {"std_by_join": {**self.join_parts}}),
            **({} if self.delay_parts is None else {"std_by_delay": dict(self.delay_parts)}),
            "flags": self.flags,
        }


def material_properties(
    curve: Curve, settings: PropertySettings, points: tuple[int, int] | None = None
) -> Properties:
    """Compute the material properties that a laboratory reports for a tensile test.

    Parameters
    ----------
    curve : Curve
        Load and strain, such as from `read_curve`.
    settings : PropertySettings
        The area and the declared uncertainties.
    points : tuple of int, optional
        First point of the window of the elastic slope, and the point after its last one. Default: the window
        of the settings, or the objective window.

    Returns
    -------
    Properties
        Each value has its standard deviation, rule, window and flags. If a value cannot be determined, it is
        None, and its flags give the reason.
    """
    require_kind("curve", curve, Curve, "read it with dic.read_curve")
    require_kind(
        "settings", settings, PropertySettings, "give dic.properties.PropertySettings(area_mm2=120.0)"
    )
    record = record_of(curve, settings.area_mm2)
    found = elastic_line(record, settings, points)
    _require_possible(record, found)
    if isinstance(found, PropertyValue):
        return _without_line(record, settings, found)
    plateau = find_plateau(record, found)
    elastic = compared(record, found, settings, plateau if isinstance(plateau, Plateau) else None)
    return _with_line(record, settings, elastic, plateau)


def _require_possible(record: Record, found: Elastic | PropertyValue) -> None:
    """Raise an error if no material can have these values, so that a unit or the area must be wrong."""
    e_gpa = 0.0 if isinstance(found, PropertyValue) else 1e-3 * found.line.slope
    remedy = "check the units of load and strain, the area, and marks between thousands"
    if e_gpa > _MOST_GPA:
        expected = f"a modulus of at most {_MOST_GPA:g} GPa, which diamond has"
        raise CurveError(record.curve.source, "modulus", expected, f"{e_gpa:.4g} GPa", remedy)
    if (most_mpa := float(record.stress.max())) > _MOST_MPA:
        expected = f"stresses of at most {_MOST_MPA:g} MPa, which the strongest fibres have"
        raise CurveError(record.curve.source, "stress", expected, f"{most_mpa:.4g} MPa", remedy)


def offset_key(offset_percent: float) -> str:
    """Return the key of an offset yield strength: "Rp02_mpa" for 0.2 %."""
    return f"Rp{f'{offset_percent:g}'.replace('.', '')}_mpa"


def _with_line(
    record: Record, settings: PropertySettings, elastic: Elastic, found: Plateau | str
) -> Properties:
    plateau = found if isinstance(found, Plateau) else None
    values = {"E_gpa": elastic.value(settings), "nu": poisson_ratio(record, elastic)}
    for offset in settings.offsets_percent:
        values[offset_key(offset)] = offset_strength(record, elastic, settings, offset, plateau)
    if isinstance(found, Plateau):
        values["ReH_mpa"] = upper_yield(record, elastic, settings, found)
        values["ReL_mpa"] = lower_yield(record, elastic, settings, found)
        values["Ae_percent"] = yield_extension(record, elastic, settings, found)
    else:
        values |= _no_plateau(found)
    at = strength_point(record, plateau)
    values["Rm_mpa"] = tensile_strength(record, settings, at, plateau)
    agt, ag = uniform_elongations(record, elastic, settings, at, plateau)
    values |= {"Ag_percent": ag, "Agt_percent": agt}
    values["A_percent"] = elongation_at_break(record, elastic, settings)
    curve = true_curve(record, elastic, at)
    part = hardening_range(record, elastic, settings, at)
    if isinstance(part, str):
        reason = part if record.curve.transverse is not None else NO_TRANSVERSE
        values |= {"r": missing("1", R_RULE, reason), "n": missing("1", N_RULE, part)}
    else:
        values["r"] = strain_ratio(record, elastic, *part)
        values["n"] = hardening_exponent(curve, *part)
    laws = hardening_laws(curve, plateau)
    return Properties(record, settings, elastic, plateau, values, necking(record, agt), laws, curve)


def _no_plateau(reason: str) -> dict[str, PropertyValue]:
    units = {"ReH_mpa": ("MPa", REH_RULE), "ReL_mpa": ("MPa", REL_RULE), "Ae_percent": ("%", AE_RULE)}
    return {name: missing(unit, rule, reason) for name, (unit, rule) in units.items()}


def _without_line(record: Record, settings: PropertySettings, e_gpa: PropertyValue) -> Properties:
    """Return the properties of a test without an elastic line: only Rm, all others are missing."""
    reason = "no elastic line was found"
    values = {"E_gpa": e_gpa, "nu": missing("1", NU_RULE, reason)}
    for offset in settings.offsets_percent:
        values[offset_key(offset)] = missing("MPa", OFFSET_RULE.format(offset), reason)
    values |= _no_plateau(reason)
    values["Rm_mpa"] = tensile_strength(record, settings, record.top)
    rules = {"Ag_percent": AG_RULE, "Agt_percent": AGT_RULE, "A_percent": A_RULE}
    values |= {name: missing("%", rule, reason) for name, rule in rules.items()}
    values |= {"r": missing("1", R_RULE, reason), "n": missing("1", N_RULE, reason)}
    neck = missing("1", NECK_RULE, reason)
    return Properties(record, settings, None, None, values, neck, {}, None)
