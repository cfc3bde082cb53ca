"""Read the file of a testing machine's table: its encoding, separator, headings and blocks."""

import csv
import re
from collections import Counter
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from dic.errors import CurveError
from dic.files.reading import read_bytes
from dic.records.decimals import is_number
from dic.records.headings import joined_with_units
from dic.records.table import CellTable
from dic.typing import PathLike

MOST_BYTES = 256 * 2**20
"""Largest size of a record file; an hour of readings at 1 kHz is smaller."""
_SEPARATORS = (";", "\t", "|", ",", " ")
_SAMPLE = 60
_MOST_DESCRIBING = 12
"""Largest number of lines of numbers that describe a test, above its table."""


def read_table(path: PathLike, *, with_names: bool = False) -> CellTable:
    """Read the cells of a testing machine's table.

    The separator is the character that splits the lines in the middle of the file into equally many numbers.
    Lines before the first line of numbers are headings.

    `with_names`: True if one column may contain names instead of numbers.

    Raises `CurveError` if the file cannot be read or has no table of numbers.
    """
    # Some programs write the sign of a number as the character of typesetters.
    text = _decoded(path).replace("\u2212", "-")
    texts = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
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
    width = Counter(len(row) for _, row in cells if _numeric_share(row) > least).most_common(1)[0][0]
    first = _first_of_table(path, cells, width, least)
    headings = [row for _, row in cells[:first]]
    if separator == " ":
        joined = [joined_with_units(row) for row in headings]
        headings = [new if len(new) == width else row for new, row in zip(joined, headings, strict=True)]
    body = _without_repeated_headings(path, cells, first, least)
    if separator != " ":
        _filled_at_end(body, headings, width)
    for line, row in body:
        if len(row) != width:
            raise CurveError(
                str(path),
                f"line {line}",
                f"{width} cells as in the other lines",
                str(len(row)),
                "complete or delete the line, and separate columns by another character than the decimals"
                if _numeric_share(row) > least
                else "give one block of the file, because here begins one with other headings",
            )
    if separator == ",":
        _require_no_decimal_commas(path, body)
    return CellTable(str(path), headings, [row for _, row in body], [line for line, _ in body], separator)


def _first_of_table(path: PathLike, cells: list[tuple[int, list[str]]], width: int, least: float) -> int:
    """Return the index of the first line of numbers, after the lines that describe the test.

    A few lines of numbers belong to a description, such as the results of the test or the header of a
    program, if other headings stand below them than above.
    """
    numbers = [k for k, (_, row) in enumerate(cells) if _numeric_share(row) > least]
    first = next(k for k in numbers if len(cells[k][1]) == width)
    for begin, after in _heading_blocks(cells, numbers):
        above = [row for _, row in cells[:begin] if _is_heading(row)]
        below = [row for _, row in cells[begin:after] if _is_heading(row)]
        few = sum(k < begin for k in numbers) <= _MOST_DESCRIBING
        if (
            few
            and above
            and below
            and len(cells[after][1]) == width
            and not any(row in above for row in below)
        ):
            first = after
    if (early := [k for k in numbers if k < first]) and len(early) > _MOST_DESCRIBING:
        expected, got = "one table of numbers", f"another one with {len(cells[early[0]][1])} columns in line"
        remedy = "give one of them as a file of its own"
        raise CurveError(str(path), "read the record", expected, f"{got} {cells[early[0]][0]}", remedy)
    return first


def _heading_blocks(cells: list[tuple[int, list[str]]], numbers: list[int]) -> list[tuple[int, int]]:
    """Return the first and the stop index of the blocks of text between lines of numbers.

    A single line of text is no block unless an empty line stands before it: it notes an event of the test.
    """
    blocks = []
    for before, after in pairwise(numbers):
        empty_line = after - before > 1 and cells[before + 1][0] - cells[before][0] > 1
        if after - before > 2 or empty_line:
            blocks.append((before + 1, after))
    return blocks


def _is_heading(row: Sequence[str]) -> bool:
    """Return whether a line is one of headings: several cells with words, and no number."""
    words = sum(bool(re.search(r"[^\W\d_]{2}", cell)) for cell in row)
    return words >= 2 and not any(map(is_number, filter(None, row)))


def _filled_at_end(body: list[tuple[int, list[str]]], headings: list[list[str]], width: int) -> None:
    """Add empty cells to the lines at the end, for a test that ended earlier than the one at its left.

    Some programs leave out the separators behind the longer test. Only headings that repeat those at the
    left show that the missing cells belong to another test.
    """
    first = len(body)
    while first and len(body[first - 1][1]) < width:
        first -= 1
    short = {len(row) for _, row in body[first:]}
    at_left = next(iter(short), 0)
    names = next((line for line in reversed(headings) if len(line) == width and _is_heading(line)), [])
    repeated = names and set(names[at_left:]) <= set(names[:at_left])
    if len(body) - first < 2 or len(short) != 1 or not repeated:
        return
    for _, row in body[first:]:
        row += [""] * (width - at_left)


def _without_repeated_headings(
    path: PathLike, cells: list[tuple[int, list[str]]], first: int, least: float
) -> list[tuple[int, list[str]]]:
    """Return the lines of numbers, without the headings that are repeated before each block of a test.

    Raises `CurveError` if a block has other headings than the first one, such as other units.
    """
    repeated = [row for _, row in cells[:first]][-2:]
    body: list[tuple[int, list[str]]] = []
    text: list[tuple[int, list[str]]] = []
    for line, row in cells[first:]:
        if _numeric_share(row) > least:
            body += text
            text = []
            body.append((line, row))
        else:
            text.append((line, row))
            if repeated and [each for _, each in text[-len(repeated) :]] == repeated:
                text = []
            elif body and any(_is_like(row, one) for one in repeated):
                raise _other_block(path, line, row)
    return body + text


def _is_like(row: Sequence[str], heading: Sequence[str]) -> bool:
    """Return whether a line has most cells of a heading, in another order or with other ones between."""
    shared = (set(row) & set(heading)) - {""}
    return list(row) != list(heading) and len(shared) >= 2 and 2 * len(shared) >= len(set(row) - {""})


def _other_block(path: PathLike, line: int, row: Sequence[str]) -> CurveError:
    expected, got = "blocks with the same headings", f"another block, {' '.join(row)[:60]!r}"
    return CurveError(str(path), f"line {line}", expected, got, "give each block as a file of its own")


def _require_no_decimal_commas(path: PathLike, body: list[tuple[int, list[str]]]) -> None:
    """Raise an error if commas separate the columns and seem to stand before decimals as well.

    Then no cell has a point, and a part of the cells begins with zeros, as 00025 in 0,00025.
    """
    columns = list(zip(*(row for _, row in body), strict=True))
    if any("." in cell for column in columns for cell in column):
        return
    for at, column in enumerate(columns):
        filled = [cell for cell in column if cell]
        padded = sum(cell.isdecimal() and len(cell) > 1 and cell.startswith("0") for cell in filled)
        if at and filled and padded >= 0.05 * len(filled):
            raise CurveError(
                str(path),
                "read the record",
                "commas between the columns or before the decimals",
                f"both, as in {','.join(body[0][1])[:60]!r}",
                "export the file with semicolons or tabs between the columns, or with decimal points",
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
        # In a short table, and between blocks of a long one, many lines are headings, so leave them out.
        numeric = [share for share in shares if share > least]
        share = float(np.mean(numeric if 2 * len(numeric) >= len(shares) else shares))
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
    return sum(bool(is_number(cell)) for cell in filled) / len(filled) if filled else 0.0
