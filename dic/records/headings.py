"""Headings of a record's columns: names, and units with which the user's units are compared."""

import re
from collections.abc import Sequence

from dic.records.unit_names import NamedUnit, multiplier_in, named_unit

_BRACKETS = re.compile(r"\s*(?:\(([^()]*)\)|\[([^\[\]]*)\]|\{([^{}]*)\}|<([^<>]*)>)$")
_LAST_WORD = re.compile(r"(.*?)([\s,;/_:.]|\bin\s|\s)([^\s,;/_:.]+/?[^\s,;/_:.]*)\.?$")
_GLUED = re.compile(r"(.*[a-zà-ÿ])(kN|daN|MPa|GPa|kgf|lbf)$")
_NONE = ("", "-", "–")
"""Cells of a line of units that name none."""
_WORDS = ("min", "in", "bar", "g", "me", "lb", "count", "counts", "digits", "ton", "tons", "second", "mil")
"""Units that are also words of a name, as in "Load min"; outside brackets they are no units."""
_OF_FORCE = re.compile(r"(?i).*(load|force|kraft|last|carga|fuerza|effort|^f\b|^f[/_,: ])")
_OF_TIME = re.compile(r"(?i).*(time|zeit|temps|tiempo|^t[/_,: ])")


def without_unit(heading: str) -> str:
    """Return a heading without the unit in brackets at its end."""
    return _BRACKETS.sub("", heading)


def units_of(line: Sequence[str]) -> list[NamedUnit | None]:
    """Return for each cell of a line above the numbers the unit that it names, or None.

    A whole cell is a unit only in a line of units: elsewhere "t" and "V" are names of columns.
    """
    cells = [cell.strip() for cell in line]
    named = [None if _is_none(cell) else named_unit(cell) for cell in cells]
    if all(unit is not None for unit, cell in zip(named, cells, strict=True) if not _is_none(cell)):
        return named
    return [_unit_behind(cell) for cell in cells]


def _is_none(cell: str) -> bool:
    return cell.strip("()[]{}<>'\" ") in _NONE


def _unit_behind(heading: str) -> NamedUnit | None:
    """Return the unit in brackets at the end of a heading, or its last word if that is a unit."""
    bracket = _BRACKETS.search(heading)
    if bracket is not None:
        return _in_brackets(
            heading[: bracket.start()], next(text for text in bracket.groups() if text is not None)
        )
    if (glued := _GLUED.fullmatch(heading)) is not None:
        return named_unit(glued[2])
    unit = named_unit(heading)
    if unit is not None and len(heading) > 1 and heading.casefold() not in _WORDS:
        return unit
    last = _LAST_WORD.fullmatch(heading)
    if last is None or last[3].casefold() in _WORDS:
        return None
    unit = named_unit(last[3])
    # A single letter is rather a name, as in "Channel V", unless the name says what it measures.
    if unit is None or (len(last[3]) == 1 and last[3] not in "%‰" and not _is_expected(unit, heading)):
        return None
    return unit


def _in_brackets(name: str, text: str) -> NamedUnit | None:
    if text.strip() in ("-", "–", "1"):
        return NamedUnit(text.strip(), "strain", 1.0)
    unit = named_unit(text)
    factor = multiplier_in(name)
    return (
        unit
        if unit is None or factor == 1.0
        else NamedUnit(f"{factor:g} {text}", unit.quantity, factor * unit.size)
    )


def _is_expected(unit: NamedUnit, heading: str) -> bool:
    names = {"force": _OF_FORCE, "time": _OF_TIME}.get(unit.quantity)
    return names is not None and names.match(heading) is not None


def joined_with_units(words: Sequence[str]) -> list[str]:
    """Return the words of a heading line that was split at spaces, with the unit in brackets behind each."""
    cells: list[str] = []
    for word in words:
        if cells and _BRACKETS.fullmatch(word):
            cells[-1] += f" {word}"
        else:
            cells.append(word)
    return cells
