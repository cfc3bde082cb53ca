"""Headings of a record's columns: names, and units with which the user's units are compared."""

import re
from collections.abc import Sequence

from dic.records.units import FORCE, LENGTH, STRAIN, STRESS, TIME

_BRACKETS = re.compile(r"\s*[(\[]\s*([^()\[\]]*?)\s*[)\]]$")
_LAST_WORD = re.compile(r".*[\s,;/_:]([^\s,;/_:]+)$")
_NONE = ("", "-", "–")
"""Cells of a line of units that name none."""
_KNOWN = {**FORCE, **LENGTH, **STRAIN, **STRESS, **TIME}
_OTHERS = frozenset(
    (
        *(
            "kp",
            "t",
            "gf",
            "tf",
            "lb",
            "lbs",
            "ton",
            "tons",
            "KN",
            "kn",
            "Kn",
            "mn",
            "kg",
            "kG",
            "g",
            "oz",
            "bar",
        ),
        *(
            "V",
            "mV",
            "A",
            "mA",
            "counts",
            "digits",
            "cm",
            "m",
            "inch",
            "ft",
            "deg",
            "rad",
            "°",
            "°C",
            "°F",
            "K",
        ),
        *("degC", "Hz", "1/s", "mm/s", "mm/min", "N/s", "kN/s", "kN/min", "MPa/s"),
    )
)
"""Units that a testing machine may write and that no option takes."""
_WORDS = ("min", "in", "bar")
"""Units that are also words of a name, as in "Load min"; outside a line of units they need brackets."""


def without_unit(heading: str) -> str:
    """Return a heading without the unit in brackets at its end."""
    return _BRACKETS.sub("", heading)


def units_of(line: Sequence[str]) -> list[str]:
    """Return for each cell of a line above the numbers the unit that it names, or an empty text.

    A whole cell is a unit only in a line of units: elsewhere "t" and "V" are names of columns.
    """
    cells = [cell.strip().replace("\u03bc", "µ") for cell in line]
    if all(is_unit(cell) for cell in cells if cell not in _NONE):
        return ["" if cell in _NONE else cell for cell in cells]
    return [_unit_behind(cell) for cell in cells]


def _unit_behind(heading: str) -> str:
    """Return the unit in brackets at the end of a heading, or its last word if that is a unit."""
    bracket = _BRACKETS.search(heading)
    if bracket is not None:
        return bracket.group(1) if is_unit(bracket.group(1)) else ""
    word = _LAST_WORD.match(heading)
    # A single letter or digit is rather a name, as in "Channel V" or "Load 1".
    for text in (heading, word.group(1) if word else ""):
        if len(text) > 1 and text not in _WORDS and is_unit(text):
            return text
    return ""


def is_unit(text: str) -> bool:
    """Return whether a text is a unit of a testing machine."""
    return text in _KNOWN or text in _OTHERS


def joined_with_units(words: Sequence[str]) -> list[str]:
    """Return the words of a heading line that was split at spaces, with the unit in brackets behind each."""
    cells: list[str] = []
    for word in words:
        if cells and _BRACKETS.fullmatch(word):
            cells[-1] += f" {word}"
        else:
            cells.append(word)
    return cells
