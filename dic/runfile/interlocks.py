"""Read what a run file says about its interlocks."""

from dataclasses import dataclass, fields
from typing import Any

from dic.runfile import schema
from dic.runfile.layout import Unlike, interlock_names


@dataclass(frozen=True)
class RunInterlock:
    """An interlock of a run: the unit of its value, and the range of the value in which the run continues.

    A missing bound is -inf or inf. The unit of a contact is empty.
    """

    unit: str
    allowed_min: float
    allowed_max: float


RANGE = frozenset(field.name for field in fields(RunInterlock))
"""Attributes of an interlock in a run file that do not belong to the device's identity."""


def read_interlocks(file: Any) -> dict[str, RunInterlock]:
    """Return the interlocks of an open run file, by name.

    Raises `Unlike` if the range of an interlock is empty: its lower bound exceeds its upper bound.
    """
    return {
        name: _read(name, file["entry"][schema.INTERLOCKS_GROUP][name].attrs)
        for name in interlock_names(file)
    }


def _read(name: str, attributes: Any) -> RunInterlock:
    low, high = float(attributes["allowed_min"]), float(attributes["allowed_max"])
    if not low <= high:
        raise Unlike(f"the interlock {name} with a range from {low:g} to {high:g}")
    return RunInterlock(str(attributes["unit"]), low, high)
