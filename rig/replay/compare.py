"""Compare a run with its replay, bit by bit."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dic.runfile import schema
from dic.runfile.reader import RunFile

_APART = {schema.ORDER.name}
"""Columns that are not compared. The order of rows differs, because a replay records no device warnings."""


def differences(run: RunFile, replayed: RunFile) -> list[str]:
    """Return one sentence for each difference in images, readings and steps."""
    found = []
    tables = ["steps", *(f"instrument/{name}" for name in ("stage", "load_frame", *run.cameras))]
    tables += [f"interlocks/{name}" for name in sorted(run.interlocks.keys() | replayed.interlocks.keys())]
    for table in tables:
        found += _of_tables(table, run.columns(table), replayed.columns(table))
    for camera in run.cameras:
        rows = zip(run.rows_on_file(camera), replayed.rows_on_file(camera), strict=False)
        changed = [
            row
            for row, other in rows
            if not np.array_equal(run.frame(camera, row), replayed.frame(camera, other))
        ]
        if changed:
            found.append(f"{camera}: {len(changed)} images differ, the first one in row {changed[0]}")
    return found


def _of_tables(table: str, ours: dict[str, NDArray[Any]], theirs: dict[str, NDArray[Any]]) -> list[str]:
    found = []
    for name in sorted((ours.keys() | theirs.keys()) - _APART):
        if name not in ours or name not in theirs:
            found.append(f"{table}: the column {name} is in one of the files only")
            continue
        a, b = ours[name], theirs[name]
        if len(a) != len(b):
            return [f"{table}: {len(a)} rows in the run, {len(b)} in the replay"]
        # Compare bits and not values, because NaN must equal NaN.
        if a.tobytes() != b.tobytes():
            row = next(i for i in range(len(a)) if a[i].tobytes() != b[i].tobytes())
            found.append(f"{table}/{name}: row {row} is {a[row]} in the run, {b[row]} in the replay")
    return found
