"""The table of a testing machine: columns that are named by headings, and their numbers in base units."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches

import numpy as np

from dic.errors import CurveError
from dic.records.decimals import Ambiguous, certain_decimal_marks, is_number, parse
from dic.records.headings import units_of, without_unit
from dic.records.unit_names import BASE, NamedUnit
from dic.records.units import STRESS, ColumnUnit
from dic.typing import Float

_TRUE = re.compile(r"(?i)\b(true|wahre[rs]?|vraie?|verdader[ao])\b")
_NEAR = 2
"""Number of lines above the numbers in which a number may be the name of a column."""


@dataclass(frozen=True)
class CellTable:
    """The cells of a testing machine's table, as text."""

    path: str
    headings: list[list[str]]
    """The cells of each line above the numbers."""
    rows: list[list[str]]
    """The cells of each line of numbers."""
    lines: list[int]
    """For each element of `rows`, the number of its line in the file, from 1."""
    separator: str = ";"

    def until_empty(self, *columns: ColumnUnit | None) -> "CellTable":
        """Return the table without the lines at its end in which all of these columns are empty.

        Of two tests side by side, the shorter one has such lines.
        """
        places = [self._place(column) for column in columns if column is not None]
        count = len(self.rows)
        while count and not any(self.rows[count - 1][at] for at in places):
            count -= 1
        return replace(self, rows=self.rows[:count], lines=self.lines[:count]) if count else self

    def values(self, column: ColumnUnit) -> Float:
        """Return the numbers of a column in base units (see `ColumnUnit.factor`); NaN for an empty cell.

        Raises `CurveError` if the column is missing or empty, has another unit in its heading, or contains
        text.
        """
        at = self._place(column)
        self._require_unit(column, at)
        self._require_engineering(column, at)
        texts = [row[at] for row in self.rows]
        for text, line in zip(texts, self.lines, strict=True):
            if text and not is_number(text):
                remedy = "correct or empty this cell, or delete the line if it does not belong to the test"
                raise self._wrong(
                    f"column '{column.name}'", "numbers", f"{text[:40]!r} in line {line}", remedy
                )
        if not any(texts):
            got = "an empty column"
            raise self._wrong(
                f"column '{column.name}'", "numbers", got, f"name another column in {column.role}"
            )
        try:
            return column.factor * parse(texts, self._marks_beside(at))
        except Ambiguous as marks:
            raise self._wrong(f"column '{column.name}'", *marks.args) from None

    def values_if(self, column: ColumnUnit | None) -> Float | None:
        """Return the numbers of a column as `values` does; None if no column is named."""
        return None if column is None else self.values(column)

    def _marks_beside(self, place: int) -> set[str]:
        """Return the certain decimal marks of all columns of numbers but one."""
        columns = (
            [row[at] for row in self.rows if row[at]] for at in range(len(self.rows[0])) if at != place
        )
        numeric = (texts for texts in columns if all(map(is_number, texts)))
        return set().union(*map(certain_decimal_marks, numeric))

    def texts(self, column: ColumnUnit) -> list[str]:
        """Return the text of a column in each line of numbers.

        Raises `CurveError` if the column is missing, or a cell is empty.
        """
        at = self._place(column)
        found = [row[at] for row in self.rows]
        for text, line in zip(found, self.lines, strict=True):
            if not text:
                step, got = f"column '{column.name}'", f"an empty cell in line {line}"
                raise self._wrong(step, "a name in each line", got, "fill in or delete the line")
        return found

    def time_like(self) -> ColumnUnit | None:
        """Return a column of numbers whose heading names the time; None if there is none.

        Such a column shows the order of the points, even if its unit is unknown.
        """
        for line in filter(self._fits, self.headings):
            for at, cell in enumerate(line):
                if re.match(r"(?i)(time|zeit)\b", cell) and len(self._places(cell)) == 1:
                    numeric = all(at < len(row) and is_number(row[at]) for row in self.rows)
                    return ColumnUnit("--time", cell, "s", 1.0, {}) if numeric else None
        return None

    def _places(self, name: str) -> list[int]:
        """Return the indices of the columns whose heading is `name`, with or without a unit in brackets."""
        for wanted in (lambda cell: cell == name, lambda cell: without_unit(cell) == name):
            # The last one is that of the table; results of the test may stand above it.
            # A number far above the table belongs to a description, and is no name of a column.
            for line in reversed(self.headings[-_NEAR:] if name.isdecimal() else self.headings):
                if places := [k for k, cell in enumerate(line) if cell and wanted(cell)]:
                    return places
        return []

    def _place(self, column: ColumnUnit) -> int:
        places = self._places(column.name)
        width = len(self.rows[0])
        if places:
            self._require_a_heading_for_each_column(column, places[0])
        if not places and column.name.isdecimal() and 1 <= int(column.name) <= width:
            return int(column.name) - 1
        if len(places) == 1 and places[0] < width:
            self._require_only_units_below(column.name)
            return places[0]
        named = max(self.headings, key=lambda line: len([cell for cell in line if cell]), default=[])
        present = ", ".join(repr(cell) for cell in named if cell) or "no headings"
        expected = "one column of this name" if places else f"one of the columns {present}"
        got = f"{len(places)} columns of this name" if places else repr(column.name)
        near = [] if places else get_close_matches(column.name, [cell for cell in named if cell], 1)
        meant = f"did you mean '{near[0]}', or " if near else ""
        raise self._wrong(
            column.role, expected, got, f"{meant}give the number of the column, from 1 to {width}"
        )

    def _require_a_heading_for_each_column(self, column: ColumnUnit, place: int) -> None:
        """Raise an error if a line of headings does not fit the columns, so that its places are uncertain."""
        fitting = (line for line in reversed(self.headings) if place < len(line))
        line = next(line for line in fitting if column.name in line[place])
        if self._fits(line):
            return
        columns, named = self._columns, _filled(line)
        if self.separator == " ":
            got = f"{len(line)} words above {columns} columns"
            remedy = f"give the number of the column, from 1 to {columns}, or separate the columns by tabs"
        else:
            got = f"{named} headings above {columns} columns"
            remedy = (
                "separate the columns by semicolons or tabs if the commas stand before decimals; otherwise "
                "give the number of the column"
            )
        raise self._wrong(column.role, "one heading for each column", got, remedy)

    @property
    def _columns(self) -> int:
        """Number of columns without empty ones at the end."""
        return max(map(_filled, self.rows))

    def _fits(self, line: Sequence[str]) -> bool:
        """Return whether the places of a line's headings are certainly those of the columns."""
        if self.separator == " ":
            return len(line) == self._columns
        return self.separator != "," or _filled(line) >= self._columns

    def _require_only_units_below(self, name: str) -> None:
        """Raise an error if a line between the headings and the first line of numbers also has numbers."""
        named = [k for k, line in enumerate(self.headings) if any(name in cell for cell in line)]
        for line in self.headings[named[-1] + 1 :]:
            texts = [cell for cell in line if cell and not is_number(cell)]
            # A cell with only "1" is not a number here, but the unit of strain.
            if any(cell != "1" and is_number(cell) for cell in line):
                remedy = "correct or delete this line"
                raise self._wrong(
                    "first lines", "numbers below the headings", repr(" ".join(texts)[:40]), remedy
                )

    def _require_unit(self, column: ColumnUnit, at: int) -> None:
        """Raise an error if the heading of a column names another unit than the user gave."""
        for unit in (units_of(line)[at] for line in self._headings_of(column, at)):
            if unit is None or not column.sizes:
                continue
            base = column.sizes.get(BASE.get(unit.quantity, ""))
            size = None if base is None else base * unit.size
            if size is not None and np.isclose(size, column.factor, rtol=1e-6):
                continue
            if unit.symbol and base is None:
                continue
            # "1" and "-" are also a number and a sign for no unit
            if unit.text in ("1", "-", "–") and base is None:
                continue
            same = next(
                (u for u, known in column.sizes.items() if size and np.isclose(size, known, rtol=1e-6)), ""
            )
            remedy = f"give {column.role} '{column.name}:{same}', or correct the heading"
            if not same:
                remedy = f"name another column, or convert this one to {column.unit} and correct its heading"
            if column.role == "--load" and unit.quantity == "stress":
                remedy = f"give --stress '{column.name}:{_stress_unit(unit)}' for a column of stress"
            raise self._wrong(column.role, f"the unit {unit.text} of the file's heading", column.unit, remedy)

    def _require_engineering(self, column: ColumnUnit, at: int) -> None:
        """Raise an error for true stress or strain: all properties are those of engineering ones."""
        if column.role not in ("--strain", "--transverse", "--stress"):
            return
        for cell in (line[at] for line in self._headings_of(column, at)):
            if _TRUE.search(cell):
                remedy = "name the column of the engineering value, or convert it and correct the heading"
                raise self._wrong(
                    column.role, "engineering stress or strain", f"the heading {cell!r}", remedy
                )

    def _headings_of(self, column: ColumnUnit, at: int) -> list[list[str]]:
        """Return the lines that may name the unit of a column: that of its name, and those below it.

        For a column that is given by its number, they are the last lines above the numbers with a cell for
        each column. Lines further above describe the test.
        """
        fitting = [line for line in self.headings if at < len(line) and self._fits(line)]
        if self._places(column.name):
            named = [k for k, line in enumerate(fitting) if column.name in line[at]]
            return fitting[named[-1] :] if named else []
        whole = [k for k, line in enumerate(fitting) if _filled(line) >= min(self._columns, 2)]
        return fitting[whole[-1] - 1 if len(whole) > 1 and whole[-1] > 0 else 0 :] if whole else []

    def _wrong(self, step: str, expected: str, got: str, remedy: str) -> CurveError:
        return CurveError(self.path, step, expected, got, remedy)


def _filled(cells: Sequence[str]) -> int:
    """Return the number of cells without the empty ones at the end."""
    return len(cells) - next((k for k, cell in enumerate(reversed(cells)) if cell), len(cells))


def _stress_unit(unit: NamedUnit) -> str:
    """Return a unit of stress as `--stress` takes it."""
    if unit.text in STRESS:
        return unit.text
    return next((name for name, size in STRESS.items() if np.isclose(size, unit.size, rtol=1e-6)), "MPa")
