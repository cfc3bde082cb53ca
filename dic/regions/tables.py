"""Read polygons from CSV tables of corners."""

import csv
from collections.abc import Sequence

_COLUMNS = {"x": "x", "x_px": "x", "y": "y", "y_px": "y", "polygon": "polygon"}
"""The columns that a table may have, in small letters, and their meanings."""

EXPECTED = "a CSV table with the columns x, y (or x_px, y_px) and, for several polygons, polygon"


def read_corners(text: str) -> list[list[list[float]]]:
    """Return the polygons of a table with one line for each corner, each a list of corners [x, y].

    The separator is a comma, a semicolon or a tab. If the separator is not a comma, decimal commas are
    allowed. A column without a name, which some programs write for the number of the line, is ignored.

    Raises `ValueError` if a column is missing, unknown or repeated, or if a cell is no number. The message
    names the column or cell.
    """
    lines = text.splitlines()
    heading = lines[0] if lines else ""
    separator = max(",;\t", key=heading.count)
    rows = csv.reader(lines, delimiter=separator)
    places = _places(next(rows, []))
    polygons: dict[str, list[list[float]]] = {}
    for row in rows:
        if not any(cell.strip() for cell in row):
            continue
        if len(row) <= max(places.values()):
            raise ValueError(f"line {rows.line_num} has {len(row)} cells")
        corner = [
            _number(row[places[axis]], f"line {rows.line_num}", decimal_comma=separator != ",")
            for axis in ("x", "y")
        ]
        name = row[places["polygon"]].strip() if "polygon" in places else ""
        polygons.setdefault(name, []).append(corner)
    return list(polygons.values())


def _places(heading: Sequence[str]) -> dict[str, int]:
    """Return the index of the column for each meaning: "x", "y" and "polygon"."""
    names = [name.strip().lower() for name in heading]
    unknown = [name for name in names if name and name not in _COLUMNS]
    if unknown:
        raise ValueError(f"unknown columns {', '.join(unknown)}")
    places: dict[str, int] = {}
    for number, name in enumerate(names):
        if name and places.setdefault(_COLUMNS[name], number) != number:
            raise ValueError(f"two columns for {_COLUMNS[name]}")
    missing = [axis for axis in ("x", "y") if axis not in places]
    if missing:
        raise ValueError(f"no column {' and no column '.join(missing)}")
    return places


def _number(cell: str, where: str, decimal_comma: bool) -> float:
    try:
        return float(cell.replace(",", ".") if decimal_comma else cell)
    except ValueError:
        raise ValueError(f"{where} has {cell.strip()[:40]!r} for a number") from None
