"""The readings of the devices at an image: their names in tables, their order and their units."""

from collections.abc import Iterable, Mapping
from typing import Any

from dic.results.schema import LATER_STEP_UNITS, STEP_UNITS
from dic.runfile.steps import CHANNEL, RunStep

READINGS = (
    *("load_n", "load_std_n", "load_lag_n", "displacement_mm", "displacement_std_mm"),
    *("angle_deg", "angle_std_deg", "time_s", "time_std_s", "due_s", "late_s"),
)
"""Names of the readings in the order of the columns; channels follow."""
_UNITS = STEP_UNITS | LATER_STEP_UNITS


def is_reading(name: str) -> bool:
    """Return True for the name of a reading or of the value of a channel."""
    return name in READINGS or name.startswith(f"{CHANNEL}_")


def reading_names(rows: Iterable[Mapping[str, Any]]) -> list[str]:
    """Return the names of all readings in rows of a table, in the order of the columns."""
    found = dict.fromkeys(name for row in rows for name in row if is_reading(name))
    return [name for name in READINGS if name in found] + [name for name in found if name not in READINGS]


def known_readings(known: Mapping[str, Any]) -> dict[str, float]:
    """Return the readings of an image that exist and are not NaN."""
    numbers = {name: float(known[name]) for name in reading_names([known]) if known[name] is not None}
    return {name: value for name, value in numbers.items() if value == value}


def unit_of_reading(name: str) -> str | None:
    """Return the unit of a reading; None for another name and for a channel."""
    return _UNITS.get(name) if name in READINGS else None


def channel_units(steps: Iterable[RunStep]) -> dict[str, str]:
    """Return the units of the columns of channels; all steps have the same channels."""
    first = next(iter(steps), None)
    channels = () if first is None else first.channels
    return {name: each.unit for each in channels for name in map(each.column, ("", "std", "lag"))}
