"""Tables of the points of interest as CSV: one file per image, one line per point."""

import csv
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from dic.correlation.status import Status
from dic.errors import MEASURE_FIRST, require_kind
from dic.files.writing import replacing
from dic.out_of_plane.correction import Correction
from dic.strain.measurement import Measurement
from dic.strain.strain import IMAGES_KEYS, STRAIN_KEYS, StrainField
from dic.typing import Float, PathLike

_PIXELS = ["x_px", "y_px", "u_px", "v_px", "zncc", "status"]
_MILLIMETRES = ["X_mm", "Y_mm", "U_mm", "V_mm", "calibration"]


class Table:
    """Writes the lines of a CSV table that a spreadsheet can open directly.

    Attributes
    ----------
    decimal_comma : bool
        True for numbers with a decimal comma and semicolons between cells, False for a decimal point and
        commas.
    """

    def __init__(self, file: Any, *, decimal_comma: bool) -> None:
        self.decimal_comma = decimal_comma
        self._writer = csv.writer(file, delimiter=";" if decimal_comma else ",")

    def write(self, cells: Iterable[object]) -> None:
        """Write a line; the cells come from `number`, or are text or whole numbers."""
        self._writer.writerow(cells)

    def number(self, value: float | None, digits: int) -> str:
        """Return a number as text with a number of decimals; empty if there is no value."""
        if value is None or value != value:
            return ""
        text = f"{value:z.{digits}f}"
        return text.replace(".", ",") if self.decimal_comma else text


@contextmanager
def new_table(path: PathLike, *, decimal_comma: bool, only_ascii: bool = True) -> Iterator[Table]:
    """Provide a table that replaces the file at `path` when the table is complete.

    Text beyond ASCII needs a byte order mark, without which spreadsheets show wrong letters.
    """
    encoding = "utf-8" if only_ascii else "utf-8-sig"
    with replacing(path) as partial, partial.open("w", newline="", encoding=encoding) as file:
        yield Table(file, decimal_comma=decimal_comma)


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
    column calibration holds "inside", or "outside" if the calibrated values are extrapolated. The next
    columns hold the local strains (without a unit), the direction of the first principal strain in degrees,
    and the standard deviations of the strains and of the direction. For calibrated strain, exx_std_images …
    are the parts of the standard deviations that the images cause. The column local_strain is empty if the
    point has a local strain, and holds the reason otherwise. If the strain was corrected, columns with the
    corrected local strains follow. If the correlation of a point failed, the status of the point gives the
    reason, and the results of the point are empty.

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
    field, calibrated = measurement.field, measurement.calibrated
    applied = correction if correction is not None and correction.declined is None else None
    names, strains = _flat(measurement.strain)
    corrected_names, corrected = ([], None) if applied is None else _flat(applied.strain)
    columns = [*_PIXELS, *(_MILLIMETRES if calibrated else []), *names, "local_strain"]
    columns += [f"corrected_{name}" for name in corrected_names]
    reasons = measurement.strain_reasons.ravel()
    points, u, v = field.points, field.u_px.ravel(), field.v_px.ravel()
    zncc, status = field.zncc.ravel(), field.status.ravel()
    with new_table(path, decimal_comma=decimal_comma) as table:
        table.write(columns)
        if calibrated:
            position, vector = calibrated.position.reshape(-1, 2), calibrated.vector.reshape(-1, 2)
            valid = calibrated.valid.ravel()
        for k in np.flatnonzero(field.active):
            line = [table.number(value, 0) for value in points[k]]
            line += [table.number(value, 6) for value in (u[k], v[k], zncc[k])]
            line.append(Status(status[k]).text)
            if calibrated:
                line += [table.number(value, 7) for value in (*position[k], *vector[k])]
                line.append("inside" if valid[k] else "outside" if status[k] == Status.CONVERGED else "")
            line += [*(table.number(value, 9) for value in strains[k]), reasons[k]]
            if corrected is not None:
                line += [table.number(value, 9) for value in corrected[k]]
            table.write(line)


def _flat(strain: StrainField) -> tuple[list[str], Float]:
    """Return the names of the known strains and their values at all points, shape (points, names)."""
    names = [*STRAIN_KEYS, *(name for name in IMAGES_KEYS if getattr(strain, name) is not None)]
    return names, np.stack([getattr(strain, name).ravel() for name in names], axis=-1)
