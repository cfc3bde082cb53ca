"""Units of the columns of a test record, and their sizes in the units that offaxis computes with."""

from collections.abc import Mapping
from dataclasses import dataclass

from dic.errors import CurveError

FORCE = {
    **{"N": 1.0, "kN": 1e3, "MN": 1e6, "mN": 1e-3, "daN": 10.0},
    **{"lbf": 4.4482216152605, "kip": 4448.2216152605, "kgf": 9.80665},
}
"""Units of load and their sizes in N."""
STRESS = {
    "MPa": 1.0,
    "GPa": 1e3,
    "kPa": 1e-3,
    "Pa": 1e-6,
    "N/mm²": 1.0,
    "N/mm2": 1.0,
    "psi": 6.894757293168e-3,
    "ksi": 6.894757293168,
}
"""Units of stress and their sizes in MPa, which is N/mm²."""
STRAIN = {
    **dict.fromkeys(("1", "mm/mm", "m/m", "in/in"), 1.0),
    "%": 1e-2,
    **dict.fromkeys(("‰", "mm/m"), 1e-3),
    **dict.fromkeys(("µε", "ue", "µm/m", "um/m"), 1e-6),
}
"""Units of strain and their sizes as a number without unit."""
LENGTH = {"mm": 1.0, "µm": 1e-3, "um": 1e-3, "in": 25.4}
"""Units of extension and their sizes in mm; extension divided by the gauge length is strain."""
TIME = {"s": 1.0, "ms": 1e-3, "min": 60.0, "h": 3600.0}
"""Units of time and their sizes in s."""


@dataclass(frozen=True)
class ColumnUnit:
    """A column of a record and the unit of its numbers."""

    role: str
    """The option that names the column, such as "--load"."""
    name: str
    """Text of the column's heading, or the number of the column, from 1."""
    unit: str
    factor: float
    """Size of the unit in N, mm or s, or as a strain; numbers of the column are multiplied by it."""
    sizes: Mapping[str, float]
    """All units that the column may have; used to compare `unit` with the unit in the file's heading."""


def column_unit(role: str, text: str, sizes: Mapping[str, float]) -> ColumnUnit:
    """Return the column and unit of a text such as ``"Load:kN"``.

    Raises `CurveError` if the unit is missing or unknown.
    """
    name, colon, unit = (part.strip() for part in text.rpartition(":"))
    known = ", ".join(sizes)
    if not colon or not name or not unit:
        raise CurveError(
            "settings",
            role,
            f"a column and its unit, COLUMN:UNIT, with one of the units {known}",
            repr(text),
            f"give {role} '{(name or unit or 'COLUMN').strip()}:UNIT', UNIT being that of your file",
        )
    size = sizes.get(unit.replace("\u03bc", "µ"))
    if size is None:
        raise CurveError(
            "settings",
            role,
            f"one of the units {known}",
            repr(unit),
            _remedy(role, name, unit),
        )
    return ColumnUnit(role, name, unit, size, sizes)


def _remedy(role: str, name: str, unit: str) -> str:
    """Return what to do about a unit that this option does not take. It must not suggest a wrong unit."""
    if role == "--load" and unit in STRESS:
        return f"give --stress '{name}:{unit}' for a column of stress"
    if role == "--stress" and unit in FORCE:
        return f"give --load '{name}:{unit}' for a column of load, and --area-mm2"
    if unit in LENGTH:
        return "give the gauge length with --gauge-length-mm for an extension"
    return f"give {role} '{name}:UNIT', UNIT being that of your file, or convert the column"


def strain_units(gauge_length_mm: float | None) -> dict[str, float]:
    """Return the units of a strain column: strains, and lengths if the gauge length is known."""
    if gauge_length_mm is None:
        return dict(STRAIN)
    return STRAIN | {unit: size / gauge_length_mm for unit, size in LENGTH.items()}
