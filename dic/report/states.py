"""The points of a stress-strain curve whose fields the report shows."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NoReturn

import numpy as np

from dic.errors import CurveError
from dic.properties.strength import strength_point, why_no_strain
from dic.report.numbers import fixed
from dic.report.tensile_record import SYMBOLS, TensileColumn

DEFAULT_STATES = ("Rp02", "half", "Rm")
MOST_STATES = 12
"""Largest number of points; more maps side by side would be too small to read."""
HALF = "half of the strain at the largest stress"
_NAMED = ("half", "Rp02", "ReH", "Rm", "last")
_EXAMPLES = "half, Rp02, ReH, Rm, last, strain=0.5 (%), stress=200 (MPa) or image=NAME"


@dataclass(frozen=True)
class CurvePoint:
    """A point of a curve."""

    words: str
    """Name of the point, such as "Rp0,2"."""
    label: str
    """The image or the run's step."""
    stress_mpa: float
    strain: float
    """Stress, and engineering strain of the gauge along the specimen."""

    @property
    def text(self) -> str:
        """Stress and strain of the point as text."""
        return f"{fixed(self.stress_mpa, 1)} MPa, {fixed(100.0 * self.strain, 3)} %"


def chosen_states(column: TensileColumn, wanted: Sequence[str] = ()) -> list[CurvePoint]:
    """Return the points of a curve that a user wants to see, in the order of the test.

    `wanted`: each is one of "half" (half of the strain at the largest stress), "Rp02", "ReH", "Rm", "last",
    "strain=PERCENT", "stress=MPA" or "image=NAME". Default: the points Rp02, half and Rm, if the curve has
    them.

    Raises `CurveError` if the curve does not have a point that is wanted.
    """
    if len(wanted) > MOST_STATES:
        expected, remedy = f"at most {MOST_STATES} points", "leave some out"
        raise CurveError("settings", "fields at", expected, str(len(wanted)), remedy)
    words: dict[int, list[str]] = {}
    for text in wanted or DEFAULT_STATES:
        point = _point(column, text, required=bool(wanted))
        if point is not None:
            words.setdefault(point, []).append(_words(text))
    record = column.properties.record
    return [
        CurvePoint(
            ", ".join(dict.fromkeys(words[point])),
            column.labels[point],
            float(record.stress[point]),
            float(record.strain[point]),
        )
        for point in sorted(words)
    ]


def _words(text: str) -> str:
    if text == "half":
        return HALF
    if text == "last":
        return "last image"
    symbol = {"Rp02": "Rp02_mpa", "ReH": "ReH_mpa", "Rm": "Rm_mpa"}.get(text)
    if symbol is not None:
        return SYMBOLS[symbol][0]
    kind, _, value = text.partition("=")
    return {"strain": f"strain {value} %", "stress": f"stress {value} MPa"}.get(kind, "chosen image")


def _point(column: TensileColumn, text: str, *, required: bool) -> int | None:
    """Return the point of the curve that a text names; None if it does not exist and is not required."""
    kind, equals, value = text.partition("=")
    if equals:
        return _given_point(column, kind, value)
    if kind not in _NAMED:
        _refuse(f"one of {_EXAMPLES}", repr(text), "give Rp02")
    found = column.properties
    strain = found.record.strain
    top = strength_point(found.record, found.plateau)
    if kind == "last":
        return len(strain) - 1
    if kind in ("Rm", "half"):
        if reason := why_no_strain(found.record, top, found.plateau):
            if required:
                _refuse("a strain at Rm", reason, "choose another point, such as last")
            return None
        if kind == "Rm":
            return top
        return _nearest(strain[: top + 1] - strain[0], 0.5 * float(strain[top] - strain[0]))
    key = f"{kind}_mpa"
    mpa = found.values[key]
    if mpa.value is None:
        if required:
            _refuse(f"a curve with {SYMBOLS[key][0]}", "; ".join(mpa.flags), "choose another point")
        return None
    if kind == "ReH":
        return int(mpa.window["point"])
    foot = 0.0 if found.elastic is None else found.elastic.foot
    return _nearest(strain[: top + 1], float(mpa.window["strain_percent"]) / 100.0 + foot)


def _given_point(column: TensileColumn, kind: str, value: str) -> int:
    """Return the point with a strain in %, a stress in MPa, or the name of an image or step."""
    record = column.properties.record
    if kind == "image":
        labels = column.labels[: record.end]
        known = [k for k, label in enumerate(labels) if value in names_of(label)]
        if len(known) != 1:
            got = f"{len(known)} of the name {value!r}"
            _refuse("one image of the curve", got, f"give image={labels[-1]}")
        return known[0]
    if kind not in ("strain", "stress"):
        _refuse(f"one of {_EXAMPLES}", repr(f"{kind}={value}"), "give strain=0.5")
    along = 100.0 * record.strain if kind == "strain" else record.strained_stress
    try:
        number = float(value)
    except ValueError:
        number = np.nan
    top = int(np.argmax(along))
    if not float(along[0]) <= number <= float(along[top]):
        expected = f"a {kind} between {along[0]:.4g} and {along[top]:.4g}, as on the curve"
        _refuse(expected, value or "none", f"give {kind}={(along[0] + along[top]) / 2:.3g}")
    return _nearest(along[: top + 1], number)


def names_of(label: str) -> set[str]:
    """Return the names that a user may give for an image or a step: with and without folder and suffix."""
    file = label.replace("\\", "/").rpartition("/")[2]
    stem = file.rpartition(".")[0] or file
    number = {label.rpartition(" ")[2]} if " " in label else set()
    return {label, file, stem} | number


def _nearest(values: np.ndarray, wanted: float) -> int:
    return int(np.argmin(np.abs(values - wanted)))


def _refuse(expected: str, got: str, remedy: str) -> NoReturn:
    raise CurveError("settings", "fields at", expected, got, remedy)
