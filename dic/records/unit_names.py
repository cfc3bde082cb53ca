"""Units as testing machines and people spell them, and what they mean.

A unit that the user gives is compared with that of the file's heading by its size, so the spelling does not
matter: KN, kn and kilonewtons are all kN. Sizes: SI; 1 lbf = 4.448 221 615 260 5 N, 1 kgf = 9.806 65 N (NIST
SP 811, appendix B).
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from math import nan
from types import MappingProxyType

from dic.records.units import FORCE, LENGTH, STRAIN, STRESS, TIME

BASE = {"force": "N", "stress": "MPa", "strain": "1", "length": "mm", "time": "s"}
"""The unit of each quantity in which sizes are given."""
_KGF, _LBF = FORCE["kgf"], FORCE["lbf"]
_EXACT = {
    "force": {**FORCE, "t": nan, "T": nan},
    "stress": STRESS,
    "strain": STRAIN,
    "length": {**LENGTH, "m": 1000.0},
    "time": TIME,
    "other": dict.fromkeys(("V", "mV", "A", "mA", "K", "Hz"), nan),
}
_SPELLED: dict[str, dict[float, str]] = {
    "force": {
        1.0: "n newton newtons",
        1e3: "kn kilonewton kilonewtons knewton knewtons",
        10.0: "dan decanewton decanewtons",
        1e-5: "dyn dyne dynes",
        _LBF: "lbf lb lbs pound pounds",
        1e3 * _LBF: "kip kips klbf klb klbs",
        _LBF / 16: "ozf oz",
        _KGF: "kgf kg kgs kp kilogram kilograms kilopond kiloponds",
        1e-3 * _KGF: "gf g gram grams",
        # The ton may be metric, long or short, and mn mega or milli, so no unit that is given agrees with it.
        nan: "tf ton tons tonne tonnes mn",
    },
    "stress": {
        1.0: "mpa n/mm2 n/mm^2 n/mm**2 megapascal megapascals",
        1e3: "gpa kn/mm2",
        1e-3: "kpa",
        1e-6: "pa pascal n/m2 n/m^2",
        0.01: "n/cm2",
        0.1: "bar",
        _KGF: "kgf/mm2 kgf/mm^2 kg/mm2 kg/mm^2 kp/mm2",
        0.01 * _KGF: "kgf/cm2 kg/cm2",
        STRESS["psi"]: "psi lbf/in2",
        STRESS["ksi"]: "ksi",
        1e3 * STRESS["ksi"]: "msi",
    },
    "strain": {
        1.0: "mm/mm m/m in/in m/m",
        1e-2: "% pct percent prozent",
        1e-3: "‰ mm/m me mε mstrain millistrain promille",
        1e-6: "µε ue µe µm/m um/m microstrain µstrain ustrain",
    },
    "length": {
        1.0: "mm millimeter millimeters millimetre millimetres",
        1e-3: "µm um micron microns micrometer micrometers micrometre",
        10.0: "cm",
        25.4: "in inch inches",
        0.0254: "mil mils",
        304.8: "ft",
    },
    "time": {
        1.0: "s sec secs second seconds sek",
        1e-3: "ms msec",
        60.0: "min mins minute minutes",
        3600.0: "h hr hrs hour hours",
    },
    "other": {
        nan: "count counts digit digits deg rad ° °c °f degc hz 1/s mm/s mm/min n/s kn/s kn/min mpa/s volts"
    },
}
_CYRILLIC = str.maketrans("кКНнМПа", "kkNNMPa")
_POWER = r"(?:[x×*]\s*(10+)(?:(?:\^|\*\*)([-−]?\d+))?|\b(10)(?:\^|\*\*)([-−]?\d+))"
"""A written factor, such as x10, ×1000 or 10^3. A plain number before a unit is a capacity or a length."""
_MULTIPLIER = re.compile(rf"{_POWER}\s*[x×*·]?\s*(.*)", re.ASCII)


@dataclass(frozen=True)
class NamedUnit:
    """A unit that a file names."""

    text: str
    """The unit as the file spells it."""
    quantity: str
    """"force", "stress", "strain", "length", "time" or "other"."""
    size: float
    """Size in N, MPa, mm or s, or as a strain; NaN if it is not certain or not known."""
    symbol: bool = False
    """True for a single letter in brackets, which may be a symbol instead, as in "Weg (s)"."""


def _table() -> Mapping[str, tuple[str, float]]:
    found: dict[str, tuple[str, float]] = {}
    for quantity, sizes in _SPELLED.items():
        for size, words in sizes.items():
            found |= dict.fromkeys(words.split(), (quantity, size))
    return MappingProxyType(found)


_WORDS = _table()


def named_unit(text: str) -> NamedUnit | None:
    """Return the unit that a text names, such as "kN", "{KN}", "10^3 N" or "lbs."; None if it names none."""
    text = text.strip(" \t.,:()[]{}<>'\"`´")
    bare = text.replace("\u03bc", "µ").replace("²", "2").translate(_CYRILLIC)
    for quantity, sizes in _EXACT.items():
        if bare in sizes:
            return NamedUnit(text, quantity, sizes[bare])
    word = " ".join(bare.split()).casefold().replace("\u03bc", "µ")
    known = _WORDS.get(word) or _WORDS.get(word.replace(" ", ""))
    if known is not None:
        return NamedUnit(text, *known)
    multiple = _MULTIPLIER.fullmatch(bare)
    inner = named_unit(multiple[5]) if multiple and multiple[5] else None
    if multiple is None or inner is None:
        return None
    return NamedUnit(text, inner.quantity, inner.size * _multiplied(multiple))


def multiplier_in(text: str) -> float:
    """Return the factor that a heading names beside its unit, as in "Load x10 (N)"; 1 without one."""
    found = re.search(_POWER, text, re.ASCII)
    return 1.0 if found is None else _multiplied(found)


def _multiplied(found: re.Match[str]) -> float:
    number, power = (found[1], found[2] or "1") if found[1] else (found[3], found[4])
    return float(float(number) ** float(power.replace("−", "-")))
