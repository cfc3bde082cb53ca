"""Write the readings of gauges as CSV tables: one line per image, and one table for each line cut."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dic.errors import require_kind
from dic.gauges.declared import Gauge
from dic.gauges.reading import Profile, Reading
from dic.gauges.series import GaugeImage, GaugeSeries
from dic.results.csv import write_rows
from dic.results.readings import reading_names
from dic.typing import PathLike

_ORDER = ("raw", "calibrated", "corrected")
_LENGTHS = ("extension", "extension_std", "length", "u", "u_std", "v", "v_std")
_DIGITS = 9


def cut_file(path: PathLike, gauge: str) -> Path:
    """Return the path of a line cut's table, which is in the folder of the table of the other gauges."""
    path = Path(path)
    return path.with_name(f"{path.stem}.{gauge}{path.suffix}")


def gauge_table_files(path: PathLike, gauges: Sequence[Gauge]) -> list[Path]:
    """Return the paths of all tables that `write_gauge_table` writes for these gauges."""
    return [Path(path), *(cut_file(path, gauge.name) for gauge in gauges if gauge.is_profile)]


def write_gauge_table(series: GaugeSeries, path: PathLike, *, decimal_comma: bool = False) -> None:
    """Write one line for each image with the readings of all gauges, and a table of each line cut.

    `docs/gauges.md` describes the columns. Columns in which no image has a value are left out. Each line cut
    has a table in a file of its own, named like `path` with the name of the cut before the suffix.

    Parameters
    ----------
    series : GaugeSeries
    path : path
    decimal_comma : bool
        True for numbers with a decimal comma and semicolons between cells.
    """
    require_kind("series", series, GaugeSeries, "read gauges first: dic.measure_gauges(results, gauges)")
    cuts = {gauge.name for gauge in series.gauges if gauge.is_profile}
    _write(path, [dict(_cells(image, cuts)) for image in series.images], decimal_comma)
    for name in sorted(cuts):
        rows = [row for image in series.images for row in _cut_rows(image, name)]
        _write(cut_file(path, name), rows, decimal_comma)


def _write(path: PathLike, rows: list[dict[str, Any]], decimal_comma: bool) -> None:
    columns = list(dict.fromkeys(name for row in rows for name in row))
    problem = [name for name in columns if name == "problem"]
    columns = [name for name in columns if name not in problem] + problem
    write_rows(path, columns, rows, _DIGITS, decimal_comma=decimal_comma)


def _cells(image: GaugeImage, cuts: set[str]) -> Iterator[tuple[str, Any]]:
    yield from _begin(image).items()
    reasons = [] if image.failure is None else [image.failure]
    for gauge, own in image.readings.items():
        if gauge in cuts:
            continue
        for kind in _ORDER:
            if kind in own:
                yield from _numbers(f"{gauge}_{kind}", own[kind])
        counted: Any = own[next(kind for kind in reversed(_ORDER) if kind in own)]
        yield f"{gauge}_points", counted.points
        if counted.lines is not None:
            yield f"{gauge}_lines", counted.lines
        if counted.reason:
            reasons.append(f"{gauge}: {counted.reason}")
    if reasons:
        yield "problem", "; ".join(reasons)


def _begin(image: GaugeImage) -> dict[str, Any]:
    names = ("camera", "step", *reading_names([image.known]), "time_source")
    known = {name: image.known.get(name) for name in names}
    return {"image": image.label} | {
        name: value for name, value in known.items() if value is not None and value == value
    }


def _numbers(start: str, reading: Reading | Profile) -> Iterator[tuple[str, float]]:
    if isinstance(reading, Reading):
        for name, value in reading.numbers().items():
            if np.isfinite(value):
                yield f"{start}_{name}{_unit_of(name, reading.unit)}", float(value)


def _unit_of(name: str, unit: str) -> str:
    return f"_{unit}" if name in _LENGTHS else ""


def _cut_rows(image: GaugeImage, name: str) -> Iterator[dict[str, Any]]:
    own: Mapping[str, Any] = image.readings.get(name, {})
    if not own:
        yield _begin(image) | {"problem": image.failure or ""}
        return
    first = next(iter(own.values()))
    for k, distance in enumerate(first.distance):
        row = _begin(image) | {f"distance_{first.distance_unit}": float(distance)}
        for kind in _ORDER:
            for value, values in own[kind].values.items() if kind in own else ():
                if np.isfinite(values[k]):
                    row[f"{kind}_{value}{_unit_of(value, own[kind].unit)}"] = float(values[k])
        row["points"] = int(first.points[k])
        if not any(np.isfinite(own[kind].values["exx"][k]) for kind in own):
            row["problem"] = _problem_at(first, k)
        yield row


def _problem_at(profile: Profile, k: int) -> str:
    """Return the reason why a place of a line cut has no value."""
    count, declared = int(profile.points[k]), int(profile.declared[k])
    if not declared:
        return "no measured point is near, or the place lies off the surface"
    if count < 0.5 * declared or count < 3:
        return f"too few points have a displacement: {count} of {declared}"
    return "the points lie on one line"
