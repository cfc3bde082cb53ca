"""The tables of all steps: raw, calibrated and corrected strain per camera, and of two cameras."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite
from string import ascii_lowercase

from dic.report.numbers import fixed, micro, micro_with_std
from dic.report.pair import PairSeries
from dic.report.series import CameraSeries, Run
from dic.runfile.reader import RunStep
from dic.typing import Float

Reading = tuple[str, str, int]

_UNITS = {"load": " N", "displacement": " mm", "rotation": "°"}
_READINGS: tuple[Reading, ...] = (
    ("Load, N", "load_n", 1),
    ("Displ., mm", "displacement_mm", 4),
    ("Angle, °", "angle_deg", 3),
)
"""Heading, attribute of a step, and decimals."""


@dataclass(frozen=True)
class Note:
    """The reason why steps were not corrected, and the footnote mark of these steps."""

    mark: str
    reason: str


@dataclass(frozen=True)
class StepRow:
    """One step of a table.

    Attributes
    ----------
    index : int
        Number of the step.
    target : str
    readings : list of str
        Readings of the devices as text, in the order of the table's headings.
    points : str
        Number of points of the values.
    cells : list of str or None
        The values as text; None if the camera could not measure the step.
    corrected : list of str
        Corrected values as text, empty if there are none.
    mark : str
        Mark of the note with the reason why corrected values are missing.
    """

    index: int
    target: str
    readings: list[str]
    points: str
    cells: list[str] | None
    corrected: list[str]
    mark: str


@dataclass(frozen=True)
class StepTable:
    """All steps of one camera, or of two together.

    Attributes
    ----------
    label : str
    readings : list of str
        Headings of the readings that at least one step has.
    rows : list of StepRow
    notes : list of Note
    """

    label: str
    readings: list[str]
    rows: list[StepRow]
    notes: list[Note]


def camera_tables(run: Run) -> list[StepTable]:
    """Return a table per camera: raw, calibrated and corrected strain, the latter with its std, in µε."""
    tables, readings = [], _readings(run)
    for series in run.cameras:
        notes = _notes(series.declined)
        at = {step.index: k for k, step in enumerate(series.steps)}
        rows = []
        for step in run.steps:
            k = at.get(step.index)
            if k is None:
                rows.append(StepRow(*_head(step, readings), "", None, [], ""))
                continue
            measurement = series.measurements[k]
            points = f"{measurement.raw_mean.points}/{measurement.field.in_view}"
            cells = [micro(value) for value in (*series.raw[k], *series.calibrated[k])]
            rows.append(StepRow(*_head(step, readings), points, cells, *_corrected(series, k, notes)))
        tables.append(StepTable(series.label, [heading for heading, *_ in readings], rows, notes))
    return tables


def pair_table(run: Run) -> StepTable | None:
    """Return the table of two cameras together: strains in µε, shift in µm, slopes in degrees, with stds."""
    pair = run.pair
    if pair is None:
        return None
    notes, readings = _notes(pair.declined), _readings(run)
    rows = []
    for k, step in enumerate(pair.steps):
        corrected, mark = _corrected(pair, k, notes)
        if corrected:
            corrected.append(f"{fixed(pair.shift_um[k], 2)} ± {fixed(pair.shift_std_um[k], 2)}")
            slopes = zip(pair.slopes_deg[k], pair.slopes_std_deg[k], strict=True)
            corrected += [f"{fixed(slope, 4)} ± {fixed(std, 4)}" for slope, std in slopes]
        rows.append(StepRow(*_head(step, readings), str(pair.points[k]), [], corrected, mark))
    return StepTable(pair.label, [heading for heading, *_ in readings], rows, notes)


def _readings(run: Run) -> list[Reading]:
    """Return the readings that at least one step has: a tension rig has no angle, a stage no load."""
    return [reading for reading in _READINGS if any(isfinite(getattr(s, reading[1])) for s in run.steps)]


def _head(step: RunStep, readings: Sequence[Reading]) -> tuple[int, str, list[str]]:
    """Return number, target and readings of a step as table cells."""
    target = f"{step.target:.6g}{_UNITS.get(step.kind, '')}"
    return step.index, target, [fixed(getattr(step, name), decimals) for _, name, decimals in readings]


def _corrected(series: CameraSeries | PairSeries, k: int, notes: Sequence[Note]) -> tuple[list[str], str]:
    reason = series.declined[k]
    if reason is not None:
        return [], next(note.mark for note in notes if note.reason == reason)
    return _strains(series.corrected[k], series.corrected_std[k]), ""


def _strains(values: Float, stds: Float) -> list[str]:
    return [micro_with_std(value, std) for value, std in zip(values, stds, strict=True)]


def _notes(declined: Sequence[str | None]) -> list[Note]:
    """Return the different reasons in the order of the steps."""
    reasons = list(dict.fromkeys(reason for reason in declined if reason is not None))
    return [Note(_mark(number), reason) for number, reason in enumerate(reasons)]


def _mark(number: int) -> str:
    letters = len(ascii_lowercase)
    return ascii_lowercase[number % letters] * (1 + number // letters)
