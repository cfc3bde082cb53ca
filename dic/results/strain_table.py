"""The table strain.csv of a series: one line per image, with raw, calibrated and corrected mean strain."""

from collections.abc import Mapping, Sequence
from typing import Any

from dic.results.csv import new_table
from dic.results.readings import reading_names
from dic.strain.tensor import COMPONENTS
from dic.typing import PathLike

STRAIN_FILE = "strain.csv"
_DIGITS = {
    "load_n": 3,
    "load_std_n": 3,
    "load_lag_n": 3,
    "displacement_mm": 6,
    "displacement_std_mm": 6,
    "angle_deg": 6,
    "angle_std_deg": 6,
    "time_s": 3,
    "time_std_s": 4,
    "due_s": 3,
    "late_s": 3,
    "converged_percent": 2,
    "rotation_deg": 6,
}
"""Number of decimals of each column; columns of strains have `_STRAIN_DIGITS` decimals."""
_STRAIN_DIGITS = 9
_KINDS = ("raw", "calibrated", "corrected")
_STRAINS = tuple(name for component in COMPONENTS for name in (component, f"{component}_std"))


def write_strain_table(
    rows: Sequence[Mapping[str, Any]], path: PathLike, *, decimal_comma: bool = False
) -> None:
    """Write one line for each image with its mean strains, their standard deviations and its readings.

    `docs/results.md` describes the columns. Columns in which no image has a value are left out.

    Parameters
    ----------
    rows : sequence of mapping
        One mapping for each image, the result of `Measurement.summary`. If there is a correction, the key
        "corrected" contains the result of `Correction.as_dict`. Further keys contain known values: "camera",
        "step", "time_source", and the readings of the devices (`RunStep.known`). For an image that was not
        measured, the mapping has the keys "file" and "error" instead of the summary.
    path : path
    decimal_comma : bool
        True for numbers with a decimal comma and semicolons between cells.
    """
    values = [_values(row) for row in rows]
    order = (*_BEFORE, *reading_names(rows), *_AFTER)
    columns = list(dict.fromkeys(name for name in order for found in values if name in found))
    only_ascii = all(str(value).isascii() for found in values for value in found.values())
    with new_table(path, decimal_comma=decimal_comma, only_ascii=only_ascii) as table:
        table.write(columns)
        for found in values:
            line = [found.get(name, "") for name in columns]
            table.write(
                table.cell(value, _DIGITS.get(name, _STRAIN_DIGITS))
                for name, value in zip(columns, line, strict=True)
            )


_BEFORE = ("image", "camera", "step")
_AFTER = (
    "time_source",
    "points",
    "converged",
    "converged_percent",
    "rotation_deg",
    *(f"{kind}_{name}" for kind in _KINDS for name in _STRAINS),
    "correction",
    "problem",
)


def _values(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return the known values of an image, keyed by the names of their columns."""
    values = {"image": row["file"], "problem": row.get("error")}
    values |= {
        name: row.get(name)
        for name in ("camera", "step", *reading_names([row]), "time_source", "points", "converged")
    }
    if row.get("points"):
        # all points that were asked for, also those whose place is not in the picture any more
        values["converged_percent"] = 100.0 * row["converged"] / (row["points"] + row["out_of_view"])
    corrected = row.get("corrected", {})
    for kind in _KINDS:
        mean = row.get(kind, {})
        if kind != "corrected" or corrected.get("applied"):
            values |= {f"{kind}_{name}": mean.get(name) for name in _STRAINS}
    if "calibrated" in row and "exx_std_images" not in row["calibrated"]:
        # Leave these columns empty, because the standard deviations in files of earlier versions contain only
        # the noise, a small part of the error.
        values |= {f"calibrated_{name}_std": None for name in COMPONENTS}
    values["rotation_deg"] = row.get("raw", {}).get("rotation_deg")
    values["correction"] = corrected.get("method") if corrected.get("applied") else corrected.get("reason")
    return {name: value for name, value in values.items() if value is not None and value == value}
