"""Headings of a record's columns: names, and units with which the user's units are compared."""

import re
from collections.abc import Sequence
from dataclasses import replace

from dic.records.unit_names import NamedUnit, multiplier_in, named_unit

_BRACKETS = re.compile(r"\s*(?:\(([^()]*)\)|\[([^\[\]]*)\]|\{([^{}]*)\}|<([^<>]*)>)$")
_LAST_WORD = re.compile(r"(.*?)([\s,;/_:.]|\bin\s|\s)([^\s,;/_:.]+/?[^\s,;/_:.]*)\.?$")
_GLUED = re.compile(r"(.*[a-zà-ÿ])(kN|daN|MPa|GPa|kgf|lbf)$")
_NONE = ("", "-", "–")
"""Cells of a line of units that name none."""
_WORDS = ("min", "in", "bar", "g", "me", "count", "counts", "digits", "ton", "tons", "second", "mil")
"""Units that are also words of a name, as in "Load min", unless the name says what it measures."""
_OF_FORCE = re.compile(r"(?i).*(load|force|kraft|last|carga|fuerza|effort|^f\b|^f[/_,: ])")
_OF_LENGTH = re.compile(r"(?i).*(extension|elongation|displacement|stroke|position|weg|crosshead)")
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
    # A number before the unit is a capacity or a gauge length, as in "Extensometer 50 mm".
    if last is None or re.search(r"(?:^|\s)\d+(?:[.,]\d+)?\s*$", last[1]):
        return None
    unit = named_unit(last[3])
    # A single letter is rather a name, as in "Channel V", unless the name says what it measures.
    short = len(last[3]) == 1 and last[3] not in "%‰"
    if unit is None or ((short or last[3].casefold() in _WORDS) and not _is_expected(unit, heading)):
        return None
    return _with_factor(last[1], unit)


def _in_brackets(name: str, text: str) -> NamedUnit | None:
    bare = text.strip()
    unit = NamedUnit(bare, "strain", 1.0) if bare in ("-", "–", "1") else named_unit(text)
    if unit is None:
        return None
    return _with_factor(name, replace(unit, symbol=len(bare) == 1 and bare in "tTsAVmghK"))


def _with_factor(name: str, unit: NamedUnit) -> NamedUnit | None:
    """Return a unit with the factor that a heading names before it, as in "Load x10 (N)"."""
    factor = multiplier_in(name)
    if factor == 1.0:
        return unit
    # "Strain x10^6" may be a strain in millionths, or in millions.
    if unit.quantity == "strain" and factor > 1.0:
        return None
    return replace(unit, text=f"{factor:g} {unit.text}", size=factor * unit.size)


def _is_expected(unit: NamedUnit, heading: str) -> bool:
    names = {"force": _OF_FORCE, "time": _OF_TIME, "length": _OF_LENGTH}.get(unit.quantity)
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
