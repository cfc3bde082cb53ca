"""The tables of every step: per camera raw, calibrated and corrected, and of two cameras together."""

from collections.abc import Sequence
from dataclasses import dataclass
from string import ascii_lowercase

from dic.report.numbers import fixed, micro
from dic.report.pair import PairSeries
from dic.report.series import CameraSeries, Run
from dic.runfile.reader import RunStep
from dic.typing import Float

_UNITS = {"load": "N", "displacement": "mm", "rotation": "°"}


@dataclass(frozen=True)
class Note:
    """Why steps were not corrected, and the mark by which they refer to it."""

    mark: str
    reason: str


@dataclass(frozen=True)
class StepRow:
    """One step of a table.

    Attributes
    ----------
    step : RunStep
    target : str
    points : str
        How many points the values come from.
    cells : list of str or None
        The values as text; None if the camera could not measure the step.
    corrected : list of str
        Corrected values as text, empty if there are none.
    mark : str
        Of the note that says why there are none.
    """

    step: RunStep
    target: str
    points: str
    cells: list[str] | None
    corrected: list[str]
    mark: str


@dataclass(frozen=True)
class StepTable:
    """All steps of one camera, or of two together."""

    label: str
    rows: list[StepRow]
    notes: list[Note]


def camera_tables(run: Run) -> list[StepTable]:
    """Return a table per camera; raw and calibrated strain as µε, corrected with its standard deviation."""
    tables = []
    for series in run.cameras:
        notes = _notes(series.declined)
        at = {step.index: k for k, step in enumerate(series.steps)}
        rows = []
        for step in run.steps:
            k = at.get(step.index)
            if k is None:
                rows.append(StepRow(step, _target(step), "", None, [], ""))
                continue
            measurement = series.measurements[k]
            points = f"{measurement.raw_mean.points}/{measurement.field.in_view}"
            cells = [micro(value) for value in (*series.raw[k], *series.calibrated[k])]
            rows.append(StepRow(step, _target(step), points, cells, *_corrected(series, k, notes)))
        tables.append(StepTable(series.label, rows, notes))
    return tables


def pair_table(run: Run) -> StepTable | None:
    """Return the table of two cameras together: strains in µε, shift in µm, slopes in degrees, with stds."""
    pair = run.pair
    if pair is None:
        return None
    notes = _notes(pair.declined)
    rows = []
    for k, step in enumerate(pair.steps):
        corrected, mark = _corrected(pair, k, notes)
        if corrected:
            corrected.append(f"{fixed(pair.shift_um[k], 2)} ± {fixed(pair.shift_std_um[k], 2)}")
            slopes = zip(pair.slopes_deg[k], pair.slopes_std_deg[k], strict=True)
            corrected += [f"{fixed(slope, 4)} ± {fixed(std, 4)}" for slope, std in slopes]
        rows.append(StepRow(step, _target(step), str(pair.points[k]), [], corrected, mark))
    return StepTable(pair.label, rows, notes)


def _corrected(series: CameraSeries | PairSeries, k: int, notes: Sequence[Note]) -> tuple[list[str], str]:
    reason = series.declined[k]
    if reason is not None:
        return [], next(note.mark for note in notes if note.reason == reason)
    return _strains(series.corrected[k], series.corrected_std[k]), ""


def _strains(values: Float, stds: Float) -> list[str]:
    return [f"{micro(value)} ± {micro(std)}" for value, std in zip(values, stds, strict=True)]


def _target(step: RunStep) -> str:
    return f"{step.target:.6g} {_UNITS.get(step.kind, '')}".rstrip()


def _notes(declined: Sequence[str | None]) -> list[Note]:
    """Return the different reasons in the order of the steps."""
    reasons = list(dict.fromkeys(reason for reason in declined if reason is not None))
    return [Note(_mark(number), reason) for number, reason in enumerate(reasons)]


def _mark(number: int) -> str:
    letters = len(ascii_lowercase)
    return ascii_lowercase[number % letters] * (1 + number // letters)
