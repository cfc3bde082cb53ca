"""Tables of the points of interest as CSV: one file per image, one line per point."""

import csv
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from io import StringIO
from itertools import chain, groupby
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dic.correlation.status import Status
from dic.errors import MEASURE_FIRST, require_kind
from dic.files.writing import replacing
from dic.out_of_plane.correction import Correction
from dic.results.fixed_text import FixedLines
from dic.results.points import CORRECTED, PointValues
from dic.strain.measurement import STRAIN_REASONS, Measurement
from dic.typing import PathLike

_MILLIMETRES = ["X_mm", "Y_mm", "U_mm", "V_mm"]
_OTHERS = {"u_px", "v_px", "zncc", "status", *_MILLIMETRES, "std_u_px", "std_v_px", "valid"}
"""Names of the values that are not strains."""
_END = b"\r\n"
_BLOCK = 2048
"""Number of lines that are written at once, so that their bytes stay in the processor's cache."""


class CsvTable:
    """Writes the lines of a CSV table that a spreadsheet can open directly.

    `decimal_comma`: True for numbers with a decimal comma and semicolons between cells, False for a decimal
    point and commas.
    """

    def __init__(self, file: Any, *, decimal_comma: bool) -> None:
        self.decimal_comma = decimal_comma
        self._writer = csv.writer(file, delimiter=";" if decimal_comma else ",")

    def write(self, cells: Iterable[object]) -> None:
        """Write a line of cells: results of `number`, texts or whole numbers."""
        self._writer.writerow(cells)

    def cell(self, value: object, digits: int) -> object:
        """Return a value of any kind as a cell. Text never becomes a formula of a spreadsheet.

        Names of files may begin with an equals sign. Source: OWASP, CSV Injection: an apostrophe before the
        cell makes it text.
        """
        if isinstance(value, float):
            return self.number(value, digits)
        formula = isinstance(value, str) and value.startswith(("=", "+", "-", "@", "\t", "\r"))
        return f"'{value}" if formula else value

    def number(self, value: float | None, digits: int) -> str:
        """Return a number as text with the given number of decimals; empty if there is no value."""
        if value is None or value != value:
            return ""
        text = f"{value:z.{digits}f}"
        return text.replace(".", ",") if self.decimal_comma else text


@contextmanager
def new_table(path: PathLike, *, decimal_comma: bool, only_ascii: bool = True) -> Iterator[CsvTable]:
    """Provide a table that replaces the file at `path` when the table is complete.

    Text beyond ASCII needs a byte order mark, without which spreadsheets show wrong letters.
    """
    encoding = "utf-8" if only_ascii else "utf-8-sig"
    with replacing(path) as partial, partial.open("w", newline="", encoding=encoding) as file:
        yield CsvTable(file, decimal_comma=decimal_comma)


def write_rows(
    path: PathLike,
    columns: Sequence[str],
    rows: Sequence[Mapping[str, Any]],
    digits: int,
    *,
    decimal_comma: bool,
) -> None:
    """Write a table with the given columns. Numbers of type float are written with `digits` decimals.

    A row need not have a value for each column.
    """
    only_ascii = all(str(value).isascii() for row in rows for value in row.values())
    with new_table(path, decimal_comma=decimal_comma, only_ascii=only_ascii) as table:
        table.write(columns)
        for row in rows:
            cells = [row.get(name, "") for name in columns]
            table.write(table.cell(cell, digits) for cell in cells)


def write_csv(
    measurement: Measurement,
    path: PathLike,
    *,
    correction: Correction | None = None,
    decimal_comma: bool = False,
) -> None:
    """Write the points of interest of a measurement as a CSV table.

    The first columns are x_px, y_px, u_px, v_px (image axes: x right, y down), zncc and status. If there is a
    calibration, the columns X_mm, Y_mm, U_mm, V_mm (grid axes: X right, Y up) and calibration follow. The
    column calibration contains "inside", or "outside" if the calibrated values are extrapolated. The next
    columns contain the local strains (without a unit), the direction of the first principal strain in
    degrees, and the standard deviations of the strains and of the direction. For calibrated strain,
    exx_std_images … are the parts of the standard deviations that the images cause. The column local_strain
    is empty if the point has a local strain; otherwise it gives the reason why not. If the strain was
    corrected, columns with the corrected local strains follow. The last columns are the standard deviations
    of u_px and v_px and, if the strain was corrected, places and displacements in the specimen's own plane.
    If the correlation of a point failed, the status of the point gives the reason, and the results of the
    point are empty.

    Parameters
    ----------
    measurement : Measurement
    path : path
    correction : Correction, optional
        Correction of the strain for motion out of the grid's plane.
    decimal_comma : bool
        True for numbers with a decimal comma and semicolons between cells.
    """
    require_kind("measurement", measurement, Measurement, MEASURE_FIRST)
    require_kind("correction", correction, Correction | None, "give image.correction of a measured series")
    write_points(PointValues.of(measurement, correction), path, decimal_comma=decimal_comma)


def write_points(points: PointValues, path: PathLike, *, decimal_comma: bool = False) -> None:
    """Write the points of interest of an image as `write_csv` describes."""
    names, columns = zip(*_columns(points), strict=True)
    shown = np.flatnonzero(points.active)
    with replacing(path) as partial, partial.open("wb") as file:
        file.write(_line(list(chain(*names)), decimal_comma=decimal_comma))
        for start in range(0, len(shown), _BLOCK):
            block = shown[start : start + _BLOCK]
            lines = FixedLines(len(block), *((";", ",") if decimal_comma else (",", ".")))
            for column in columns:
                column.add(lines, block)
            written = lines.joined()
            if lines.doubtful.any():
                each = written.split(_END)
                for n in np.flatnonzero(lines.doubtful).tolist():
                    cells = [cell for column in columns for cell in column.cells(int(block[n]))]
                    each[n] = _line(cells, decimal_comma=decimal_comma).removesuffix(_END)
                written = _END.join(each)
            file.write(written)


def _line(cells: Sequence[tuple[float, int] | str], *, decimal_comma: bool) -> bytes:
    """Return a line of texts and of numbers with their numbers of decimals."""
    text = StringIO(newline="")
    table = CsvTable(text, decimal_comma=decimal_comma)
    table.write(cell if isinstance(cell, str) else table.number(*cell) for cell in cells)
    return text.getvalue().encode()


@dataclass(frozen=True)
class _Texts:
    """A column of texts, of which there are few: that of a point is `texts[index]`."""

    texts: Sequence[str]
    index: NDArray[Any]

    def add(self, lines: FixedLines, block: NDArray[np.intp]) -> None:
        lines.add_texts(self.texts, self.index[block])

    def cells(self, k: int) -> list[str]:
        return [self.texts[self.index[k]]]


@dataclass(frozen=True)
class _Numbers:
    """Columns of numbers with the same number of decimals."""

    values: Sequence[NDArray[Any]]
    digits: int

    def add(self, lines: FixedLines, block: NDArray[np.intp]) -> None:
        values = np.stack([each[block] for each in self.values], axis=1)
        lines.add_numbers(values.astype(np.float64, copy=False), self.digits)

    def cells(self, k: int) -> list[tuple[float, int]]:
        return [(float(each[k]), self.digits) for each in self.values]


def _columns(points: PointValues) -> Iterator[tuple[list[str], _Texts | _Numbers]]:
    """Yield the columns of the points of an image with their names, in their order."""
    values = {name: value.ravel() for name, value in points.values.items()}

    def numbers(names: Iterable[str]) -> Iterator[tuple[list[str], _Numbers]]:
        for digits, some in groupby(names, _digits):
            chosen = list(some)
            yield chosen, _Numbers([values[name] for name in chosen], digits)

    rows, columns = (index.ravel() for index in np.indices(points.active.shape))
    for name, along, index in (("x_px", points.x_px, columns), ("y_px", points.y_px, rows)):
        yield [name], _Texts([f"{value:z.0f}" for value in along.tolist()], index)
    yield from numbers(("u_px", "v_px", "zncc"))
    yield ["status"], _Texts([status.text for status in Status], values["status"])
    strains = [name for name in values if name not in _OTHERS and not name.startswith(CORRECTED)]
    corrected = [name for name in values if name.startswith(CORRECTED)]
    if "X_mm" in values:
        yield from numbers(_MILLIMETRES)
        outside = 2 * (values["status"] == Status.CONVERGED)
        yield ["calibration"], _Texts(["", "inside", "outside"], np.where(values["valid"], 1, outside))
    yield from numbers(strains)
    yield ["local_strain"], _Texts(STRAIN_REASONS, points.measurement.strain_reason_index.ravel())
    yield from numbers(name for name in corrected if name.removeprefix(CORRECTED) not in _OTHERS)
    yield from numbers(("std_u_px", "std_v_px"))
    yield from numbers(f"{CORRECTED}{name}" for name in _MILLIMETRES if corrected)


def _digits(name: str) -> int:
    """Return the number of decimals of a value.

    The last decimal is far below the standard deviation of a good measurement.
    """
    if name.endswith("_mm"):
        return 7
    return 6 if name in _OTHERS else 9
