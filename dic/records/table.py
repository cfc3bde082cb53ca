"""Read the table of a testing machine, with any separator and decimal mark, and with lines of text on top."""

import csv
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dic.errors import CurveError
from dic.files.reading import read_bytes
from dic.records.units import ColumnUnit
from dic.typing import Float, PathLike

MOST_BYTES = 256 * 2**20
"""Largest size of a record file; an hour of readings at 1 kHz is smaller."""
_SEPARATORS = (";", "\t", "|", ",", " ")
_NUMBER = re.compile(r"[+-]?(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eE][+-]?\d+)?", re.ASCII)
_BRACKETS = re.compile(r"\s*[(\[]\s*([^()\[\]]*?)\s*[)\]]$")
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}[.,]\d{3}")
_UP_TO_999 = re.compile(r"[+-]?\d{1,3}")
_SAMPLE = 60


@dataclass(frozen=True)
class Table:
    """The cells of a testing machine's table, as text.

    Attributes
    ----------
    path : str
    headings : list of list of str
        The cells of each line above the numbers.
    rows : list of list of str
        The cells of each line of numbers.
    lines : list of int
        For each element of `rows`, the number of its line in the file, from 1.
    """

    path: str
    headings: list[list[str]]
    rows: list[list[str]]
    lines: list[int]

    def values(self, column: ColumnUnit) -> Float:
        """Return the numbers of a column in base units (see `ColumnUnit.factor`); NaN for an empty cell.

        Raises
        ------
        CurveError
            If the column is missing or empty, has another unit in its heading, or contains text.
        """
        at = self._place(column)
        self._require_unit(column, at)
        texts = [row[at] for row in self.rows]
        for text, line in zip(texts, self.lines, strict=True):
            if text and not _NUMBER.fullmatch(text):
                remedy = "correct or empty this cell, or delete the line if it does not belong to the test"
                raise self._wrong(
                    f"column '{column.name}'", "numbers", f"{text[:40]!r} in line {line}", remedy
                )
        if not any(texts):
            got = "an empty column"
            raise self._wrong(
                f"column '{column.name}'", "numbers", got, f"name another column in {column.role}"
            )
        commas = sum("," in text for text in texts)
        if commas and any("." in text for text in texts):
            got, remedy = "both", "export the file without thousands separators"
            raise self._wrong(f"column '{column.name}'", "a decimal point or a decimal comma", got, remedy)
        self._require_no_thousands(column, texts)
        return column.factor * np.array([float(text.replace(",", ".")) if text else np.nan for text in texts])

    def _require_no_thousands(self, column: ColumnUnit, texts: Sequence[str]) -> None:
        """Raise an error if points or commas may separate thousands, as in 999 followed by 1,001.

        With a decimal mark, this combination does not occur. Machines write a fixed number of decimals, so no
        number is whole; or they drop zeros at the end, so the number of decimals varies.
        """
        filled = [text for text in texts if text]
        marked = [text for text in filled if "," in text or "." in text]
        whole = [text for text in filled if "," not in text and "." not in text]
        if not marked or not whole or not all(map(_THOUSANDS.fullmatch, marked)):
            return
        if all(_UP_TO_999.fullmatch(text) for text in whole):
            got = (
                f"{whole[0]!r} and {marked[0]!r}, which may be {marked[0].replace(',', '').replace('.', '')}"
            )
            remedy = "export the file without thousands separators, or with a fixed number of decimals"
            raise self._wrong(f"column '{column.name}'", "numbers whose decimals are certain", got, remedy)

    def texts(self, column: ColumnUnit) -> list[str]:
        """Return the text of a column in each line of numbers.

        Raises
        ------
        CurveError
            If the column is missing, or a cell is empty.
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
        for line in self.headings:
            for at, cell in enumerate(line):
                if re.match(r"(?i)(time|zeit)\b", cell) and len(self._places(cell)) == 1:
                    numeric = all(at < len(row) and _NUMBER.fullmatch(row[at]) for row in self.rows)
                    return ColumnUnit("--time", cell, "s", 1.0, {}) if numeric else None
        return None

    def _places(self, name: str) -> list[int]:
        """Return the indices of the columns whose heading is `name`, with or without a unit in brackets."""
        for wanted in (lambda cell: cell == name, lambda cell: _BRACKETS.sub("", cell) == name):
            for line in self.headings:
                if places := [k for k, cell in enumerate(line) if cell and wanted(cell)]:
                    return places
        return []

    def _place(self, column: ColumnUnit) -> int:
        places = self._places(column.name)
        width = len(self.rows[0])
        if not places and column.name.isdecimal() and 1 <= int(column.name) <= width:
            return int(column.name) - 1
        if len(places) == 1 and places[0] < width:
            self._require_only_units_below(column.name)
            return places[0]
        named = max(self.headings, key=lambda line: len([cell for cell in line if cell]), default=[])
        present = ", ".join(repr(cell) for cell in named if cell) or "no headings"
        expected = "one column of this name" if places else f"one of the columns {present}"
        got = f"{len(places)} columns of this name" if places else repr(column.name)
        raise self._wrong(column.role, expected, got, f"give the number of the column, from 1 to {width}")

    def _require_only_units_below(self, name: str) -> None:
        """Raise an error if a line between the headings and the first line of numbers also has numbers."""
        at = next(k for k, line in enumerate(self.headings) if any(name in cell for cell in line))
        for line in self.headings[at + 1 :]:
            texts = [cell for cell in line if cell and not _NUMBER.fullmatch(cell)]
            # A cell with only "1" is not a number here, but the unit of strain.
            if any(cell != "1" and _NUMBER.fullmatch(cell) for cell in line):
                remedy = "correct or delete this line"
                raise self._wrong("first lines", "numbers below the headings", repr(texts[0][:40]), remedy)

    def _require_unit(self, column: ColumnUnit, at: int) -> None:
        """Raise an error if the heading of a column names another unit than the user gave."""
        cells = [line[at] for line in self.headings if at < len(line)]
        for cell in cells:
            bracket = _BRACKETS.search(cell)
            unit = (bracket.group(1) if bracket else cell).replace("\u03bc", "µ")
            size = column.sizes.get(unit)
            if size is not None and not np.isclose(size, column.factor, rtol=1e-9):
                remedy = f"give {column.role} '{column.name}:{unit}', or correct the heading"
                raise self._wrong(column.role, f"the unit {unit} of the file's heading", column.unit, remedy)

    def _wrong(self, step: str, expected: str, got: str, remedy: str) -> CurveError:
        return CurveError(self.path, step, expected, got, remedy)


def read_table(path: PathLike, *, with_names: bool = False) -> Table:
    """Read the cells of a testing machine's table.

    The separator is the character that splits the lines in the middle of the file into equally many numbers.
    Lines before the first line of numbers are headings.

    Parameters
    ----------
    path : path
    with_names : bool
        True if one column may contain names instead of numbers.


    Raises
    ------
    CurveError
        If the file cannot be read or has no table of numbers.
    """
    texts = _decoded(path).replace("\r\n", "\n").replace("\r", "\n").split("\n")
    numbered = [(k, text) for k, text in enumerate(texts, 1) if text.strip(" \t;,|")]
    middle = max(0, (len(numbered) - _SAMPLE) // 2)
    least = 0.4 if with_names else 0.5
    separator = _separator([text for _, text in numbered[middle : middle + _SAMPLE]], least)
    if separator is None:
        raise CurveError(
            str(path),
            "read the record",
            "lines of numbers, separated by semicolons, tabs, bars, commas or spaces",
            "no such lines",
            "export the record as CSV, with at least a column of load and one of strain",
        )
    cells = [(line, _split(text, separator)) for line, text in numbered]
    first = next(k for k, (_, row) in enumerate(cells) if _numeric_share(row) > least)
    width = Counter(len(row) for _, row in cells[first:]).most_common(1)[0][0]
    for line, row in cells[first:]:
        if len(row) != width:
            raise CurveError(
                str(path),
                f"line {line}",
                f"{width} cells as in the other lines",
                str(len(row)),
                "complete or delete the line, and separate columns by another character than the decimals",
            )
    return Table(
        str(path),
        [row for _, row in cells[:first]],
        [row for _, row in cells[first:]],
        [line for line, _ in cells[first:]],
    )


def _decoded(path: PathLike) -> str:
    try:
        content = read_bytes(path, MOST_BYTES)
    except OSError as error:
        raise CurveError(
            str(path), "read the record", "a text file", error.strerror or str(error), "name another file"
        ) from error
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        return content.decode("utf-16", errors="replace")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        # Many testing machines write text in the encoding of western Windows (code page 1252).
        return content.decode("cp1252", errors="replace")


def _separator(sample: Sequence[str], least: float) -> str | None:
    """Return the separator that gives the largest share of numbers, with equally many cells in most lines."""
    best, best_share = None, least
    for separator in _SEPARATORS:
        rows = [_split(text, separator) for text in sample]
        width, count = Counter(map(len, rows)).most_common(1)[0] if rows else (0, 0)
        if width < 2 or count < 0.5 * len(rows):
            continue
        shares = [_numeric_share(row) for row in rows if len(row) == width]
        # In a short table, a large share of the lines are headings, so skip them before counting.
        numeric = next((k for k, share in enumerate(shares) if share > least), 0)
        share = float(np.mean(shares[numeric if 2 * numeric <= len(shares) else 0 :]))
        if share > best_share:
            best, best_share = separator, share
    return best


def _split(text: str, separator: str) -> list[str]:
    if separator == " ":
        return text.split()
    # In such tables a quoted cell never continues on the next line, so each line is split on its own.
    return [cell.strip() for cell in next(csv.reader([text], delimiter=separator))]


def _numeric_share(row: Sequence[str]) -> float:
    filled = [cell for cell in row if cell]
    return sum(bool(_NUMBER.fullmatch(cell)) for cell in filled) / len(filled) if filled else 0.0
