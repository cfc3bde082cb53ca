"""The record of a tensile test: load and strain at each instant, read from a table and checked."""

from dataclasses import dataclass

import numpy as np

from dic.errors import CurveError, require_all
from dic.records.machine import require_forwards, require_numbers
from dic.records.table_file import read_table
from dic.records.units import FORCE, STRESS, TIME, ColumnUnit, column_unit, strain_units
from dic.typing import Float, PathLike

LEAST_POINTS = 10


@dataclass(frozen=True)
class Curve:
    """Load and strain of a tensile test, in the order of the test.

    Attributes
    ----------
    source : str
        The file or the name of the record, for messages.
    load_n : ndarray, shape (n,)
    strain : ndarray, shape (n,)
        Engineering strain, without a unit; NaN from the point at which no strain is recorded any more.
    transverse : ndarray, shape (n,), or None
        Engineering strain across the specimen, negative in tension; NaN where it was not measured.
    time_s : ndarray, shape (n,), or None
    passed_n : ndarray, shape (n, 2), or None
        Instants without a strain are left out of the curve. The array has the smallest and largest load of
        the instants left out just before each point, and NaN if there are none. None if no instant was left
        out.
    load_std_n : ndarray, shape (n,), or None
        Standard deviation of each load without the errors that all loads share; NaN where it is not known.
        None if nothing states it.

    Raises
    ------
    CurveError
        If the values cannot be a tensile test: too few points, gaps, time that runs backwards, or
        compression.
    """

    source: str
    load_n: Float
    strain: Float
    transverse: Float | None = None
    time_s: Float | None = None
    passed_n: Float | None = None
    load_std_n: Float | None = None

    def __post_init__(self) -> None:
        names = ("load_n", "strain", "transverse", "time_s", "passed_n", "load_std_n")
        for name in names:
            given = getattr(self, name)
            if given is not None:
                object.__setattr__(self, name, np.asarray(given, dtype=np.float64))
        lengths = {name: getattr(self, name).shape[:1] for name in names if getattr(self, name) is not None}
        if len(set(lengths.values())) != 1 or self.load_n.ndim != 1:
            raise self._wrong("values", "columns of one length", str(lengths), "give one value per instant")
        if len(self.load_n) < LEAST_POINTS:
            got, remedy = str(len(self.load_n)), "give the whole record"
            raise self._wrong("values", f"at least {LEAST_POINTS} points", got, remedy)
        self._require_whole()
        if self.time_s is not None:
            require_numbers(self.source, "time", self.time_s)
            require_forwards(self.source, self.time_s)
        self._require_tension()

    @property
    def measured(self) -> int:
        """Number of points before the first point without a strain."""
        missing = np.flatnonzero(np.isnan(self.strain))
        return int(missing[0]) if missing.size else len(self.strain)

    def _require_whole(self) -> None:
        require_numbers(self.source, "load", self.load_n)
        end = self.measured
        # Strain may end early, because an extensometer is taken off. It cannot begin again later.
        if np.isfinite(self.strain[end:]).any():
            expected, got = (
                "numbers without gaps up to the end of the measurement",
                f"a gap at point {end + 1}",
            )
            remedy = "delete the lines without strain, or give the strain there"
            raise self._wrong("strain", expected, got, remedy)
        if end < LEAST_POINTS:
            remedy = "name another column of strain"
            raise self._wrong(
                "strain", f"at least {LEAST_POINTS} numbers from the first point on", str(end), remedy
            )

    def _require_tension(self) -> None:
        low, high = float(self.load_n.min()), float(self.load_n.max())
        if low == high == 0.0:
            raise self._wrong("load", "a load", "zero at all points", "name another column")
        if high <= 0.0 or -low > high:
            got = f"compression: loads from {low:g} N to {high:g} N"
            remedy = (
                "give a tensile test, and change the sign of the load if the machine counts tension negative"
            )
            raise self._wrong("load", "tension, which counts positive", got, remedy)
        load, strain = self.load_n[: self.measured], self.strain[: self.measured]
        if np.ptp(strain) == 0.0:
            raise self._wrong(
                "strain", "strain that changes", "the same value at all points", "name another column"
            )
        top = max(int(np.argmax(load)), 2)
        if np.ptp(load) == 0.0 or np.corrcoef(load[: top + 1], strain[: top + 1])[0, 1] <= 0.0:
            got = "strain that falls or stands while the load rises"
            remedy = "change the sign of the strain, or name another column"
            raise self._wrong("strain", "strain that grows with the load", got, remedy)

    def _wrong(self, step: str, expected: str, got: str, remedy: str) -> CurveError:
        return CurveError(self.source, step, expected, got, remedy)


def read_curve(
    path: PathLike,
    *,
    load: str | None = None,
    strain: str,
    transverse: str | None = None,
    time: str | None = None,
    gauge_length_mm: float | None = None,
    stress: str | None = None,
    area_mm2: float = 1.0,
) -> Curve:
    """Read load and strain from the table of a testing machine.

    Separator, decimal mark, encoding and heading lines are detected. A column is named by its heading, or by
    its number from 1, and by its unit: ``"Load:kN"``, ``"3:%"``.

    Parameters
    ----------
    path : path
    load : str, optional
        Column of the load and its unit: N, kN, MN, mN, daN, lbf, kip or kgf.
    strain, transverse : str
        Column of the strain and its unit: 1, mm/mm, %, ‰, µε or others; with `gauge_length_mm` also mm, µm
        and in.
    time : str, optional
        Column of the time and its unit: s, ms, min or h. If this is not given, a column with the heading
        "Time" must still increase.
    gauge_length_mm : float, optional
        Length over which an extension was measured, mm.
    stress : str, optional
        Instead of `load`, the column of the engineering stress and its unit: MPa, N/mm², GPa, kPa, Pa, psi or
        ksi.
    area_mm2 : float, optional
        With `stress`, the area of the cross-section with which the material properties are computed, mm². The
        load of the curve is stress times area, so that any area gives the same stress again.

    Returns
    -------
    Curve

    Raises
    ------
    CurveError
        If a column or unit is wrong, or the table does not contain a tensile test.
    """
    length = gauge_length_mm if gauge_length_mm is not None else 1.0
    remedy = "give the length over which the extension was measured, such as 50"
    checks = [(0.0 < length < 1e6, "gauge length", "above 0 mm", gauge_length_mm, remedy)]
    require_all(CurveError, "settings", checks)
    units = strain_units(gauge_length_mm)
    pull, along = _pull(path, load, stress), column_unit("--strain", strain, units)
    across = None if transverse is None else column_unit("--transverse", transverse, units)
    instants = None if time is None else column_unit("--time", time, TIME)
    table = read_table(path)
    instants = instants or table.time_like()
    table = table.until_empty(pull, along, across)
    return Curve(
        str(path),
        (1.0 if stress is None else area_mm2) * table.values(pull),
        table.values(along),
        transverse=table.values_if(across),
        time_s=table.values_if(instants),
    )


def _pull(path: PathLike, load: str | None, stress: str | None) -> ColumnUnit:
    """Return the column of the load or of the stress. Raise `CurveError` if not exactly one is named."""
    if load is not None and stress is None:
        return column_unit("--load", load, FORCE)
    if stress is not None and load is None:
        return column_unit("--stress", stress, STRESS)
    got = "none" if load is None else "both"
    remedy = "give --load COLUMN:UNIT, such as --load Load:kN, or --stress COLUMN:MPa for a table of stress"
    raise CurveError(str(path), "--load", "a column of load or of stress, and its unit", got, remedy)
