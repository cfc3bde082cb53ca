"""The record of a testing machine during a test: load, and perhaps displacement, time and image names."""

from dataclasses import dataclass

import numpy as np

from dic.errors import CurveError
from dic.records.table_file import read_table
from dic.records.units import FORCE, LENGTH, TIME, ColumnUnit, column_unit
from dic.typing import Float, PathLike


@dataclass(frozen=True)
class MachineRecord:
    """The readings that a testing machine recorded, in the order of the test.

    Attributes
    ----------
    source : str
        The file, for messages.
    load_n : ndarray, shape (n,)
    displacement_mm : ndarray, shape (n,), or None
    time_s : ndarray, shape (n,), or None
        Times on the machine's clock; they never decrease.
    images : tuple of str, or None
        The name of the image that belongs to each line.
    """

    source: str
    load_n: Float
    displacement_mm: Float | None = None
    time_s: Float | None = None
    images: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        counts = {
            name: len(value)
            for name in ("load_n", "displacement_mm", "time_s", "images")
            if (value := getattr(self, name)) is not None
        }
        if len(set(counts.values())) > 1:
            got = ", ".join(f"{name} {count}" for name, count in counts.items())
            raise self.wrong("values", "columns of one length", got, "give one value of each per line")
        for name, step in (("load_n", "load"), ("displacement_mm", "displacement"), ("time_s", "time")):
            if (values := getattr(self, name)) is not None:
                require_numbers(self.source, step, values)
        if self.time_s is not None:
            require_forwards(self.source, self.time_s)

    def __len__(self) -> int:
        return len(self.load_n)

    def wrong(self, step: str, expected: str, got: str, remedy: str) -> CurveError:
        """Return an error about this record."""
        return CurveError(self.source, step, expected, got, remedy)


def require_numbers(source: str, step: str, values: Float) -> None:
    """Raise a `CurveError` if a record lacks a number at a point."""
    gaps = np.flatnonzero(~np.isfinite(values))
    if gaps.size:
        got = f"an empty cell or no number at point {gaps[0] + 1}"
        raise CurveError(source, step, "a number at each point", got, "fill in or delete the line")


def require_forwards(source: str, time_s: Float) -> None:
    """Raise a `CurveError` if the time of a record runs backwards."""
    back = np.flatnonzero(np.diff(time_s) < 0.0)
    if back.size:
        k = int(back[0])
        got = f"{time_s[k + 1]:g} s after {time_s[k]:g} s at point {k + 2}"
        remedy = "give the record of one test, in the order of the test"
        raise CurveError(source, "time", "time that does not run backwards", got, remedy)


def read_machine_record(
    path: PathLike,
    *,
    load: str,
    displacement: str | None = None,
    time: str | None = None,
    image: str | None = None,
) -> MachineRecord:
    """Read the table of a testing machine.

    Separator, decimal mark, encoding and heading lines are detected. A column is named by its heading, or by
    its number from 1, and by its unit: ``"Load:kN"``, ``"3:mm"``.

    Parameters
    ----------
    path : path
    load : str
        Column of the load and its unit: N, kN, MN, lbf, kip or kgf.
    displacement : str, optional
        Column of the crosshead's displacement and its unit: mm, µm, um or in.
    time : str, optional
        Column of the time and its unit: s, ms, min or h.
    image : str, optional
        Column with the names of the images; it has no unit.

    Raises
    ------
    CurveError
        If the file, a column or a unit cannot be used, or time runs backwards.
    """
    pull = column_unit("--load", load, FORCE)
    way = None if displacement is None else column_unit("--displacement", displacement, LENGTH)
    instants = None if time is None else column_unit("--time", time, TIME)
    names = None if image is None else ColumnUnit("--image-column", image, "", 1.0, {})
    table = read_table(path, with_names=names is not None).until_empty(pull, way, instants, names)
    images = None if names is None else tuple(table.texts(names))
    return MachineRecord(
        str(path), table.values(pull), table.values_if(way), table.values_if(instants), images
    )


def read_image_times(path: PathLike, *, image: str, time: str) -> dict[str, float]:
    """Read the times at which images were taken, in s, as a dict keyed by the images' names.

    Parameters
    ----------
    path : path
    image : str
        Column of the images' names.
    time : str
        Column of the times and its unit, such as ``"Stamp:ms"``.

    Raises
    ------
    CurveError
        If the file or a column cannot be used, or an image is named twice.
    """
    stamps = column_unit("--image-time", time, TIME)
    table = read_table(path, with_names=True)
    names = table.texts(ColumnUnit("--image-column", image, "", 1.0, {}))
    twice = sorted({name for name in names if names.count(name) > 1}) if len(set(names)) < len(names) else []
    if twice:
        remedy = "delete the line that does not belong to it"
        raise CurveError(str(path), "image times", "one line for each image", f"{twice[0]!r} twice", remedy)
    return dict(zip(names, table.values(stamps).tolist(), strict=True))
