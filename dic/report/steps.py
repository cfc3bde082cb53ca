"""The report's tables of all steps: the strains of each camera, and of two cameras together."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import floor, isfinite, log10
from operator import attrgetter
from string import ascii_lowercase

import numpy as np

from dic.report.numbers import fixed, micro, micro_with_std
from dic.report.pair import PairSeries
from dic.report.series import CameraSeries, Run
from dic.report.tables import ALL_IN
from dic.report.thinning import some_of
from dic.runfile.reader import RunStep
from dic.typing import Float

_UNITS = {"load": " N", "creep": " N", "displacement": " mm", "relaxation": " mm", "rotation": "°"}


@dataclass(frozen=True)
class Reading:
    """The readings of a device in the table: heading, the value and its standard deviation at each step."""

    heading: str
    value: Callable[[RunStep], tuple[float, float]]
    decimals: int

    def text(self, step: RunStep) -> str:
        """Return the reading at a step as text."""
        value, std = self.value(step)
        if not isfinite(std):
            return fixed(value, self.decimals)
        return f"{fixed(value, self.decimals)} ± {std:.2g}"


_READINGS = (
    Reading("Load, N", attrgetter("load_n", "load_std_n"), 1),
    Reading("Displ., mm", attrgetter("displacement_mm", "displacement_std_mm"), 4),
    Reading("Angle, °", attrgetter("angle_deg", "angle_std_deg"), 3),
)
MOST_ROWS = 20
"""Number of rows of a table of a long run."""
_CHANNEL_DIGITS = 5
"""Number of digits of a channel's largest value."""


@dataclass(frozen=True)
class Note:
    """A footnote of a table: the reason why steps were not corrected, and the mark of these steps."""

    mark: str
    reason: str


@dataclass(frozen=True)
class StepRow:
    """One row of a table of steps."""

    index: int
    """Number of the step."""
    target: str
    """Target of the step, with its unit."""
    readings: list[str]
    """Readings of the devices as text, in the order of the table's headings."""
    points: str
    """Number of points from which the strains were computed."""
    cells: list[str] | None
    """Raw and calibrated strains as text, empty for two cameras together; None if the camera could not
    measure the step.
    """
    corrected: list[str]
    """Corrected values as text; empty if the step was not corrected."""
    mark: str
    """Mark of the footnote that gives the reason why the step was not corrected; empty for a corrected step.
    """


@dataclass(frozen=True)
class StepTable:
    """The table of all steps of one camera, or of two cameras together."""

    label: str
    """Name of the camera, or of the two cameras, in the report."""
    readings: list[str]
    """Headings of the device readings that exist for at least one step."""
    rows: list[StepRow]
    notes: list[Note]
    """Footnotes of the table."""
    steps: int
    """Number of steps of which the table may have a part."""

    @property
    def left_out(self) -> str:
        """A sentence about the steps that the table leaves out; empty if it has all."""
        if len(self.rows) == self.steps:
            return ""
        return f"{len(self.rows)} of {self.steps} steps; {ALL_IN} all of them."


def camera_tables(run: Run) -> list[StepTable]:
    """Return one table of steps per camera, with raw, calibrated and corrected strain in µε.

    The table also shows the standard deviations of calibrated and corrected strain, if they are known.
    """
    tables, readings, shown = [], _readings(run), _shown(run, run.steps)
    for series in run.cameras:
        at = {step.index: k for k, step in enumerate(series.steps)}
        notes = _notes([series.declined[at[step.index]] for step in shown if step.index in at])
        rows = []
        for step in shown:
            k = at.get(step.index)
            if k is None:
                rows.append(StepRow(*_head(step, readings), "", None, [], ""))
                continue
            measurement = series.measurements[k]
            points = f"{measurement.raw_mean.points}/{measurement.field.in_view}"
            cells = [micro(value) for value in series.raw[k]]
            cells += _strains(series.calibrated[k], series.calibrated_std[k])
            rows.append(StepRow(*_head(step, readings), points, cells, *_corrected(series, k, notes)))
        headings = [each.heading for each in readings]
        tables.append(StepTable(series.label, headings, rows, notes, len(run.steps)))
    return tables


def _shown(run: Run, steps: list[RunStep]) -> list[RunStep]:
    """Return the steps of a table: of a long run those at its ends, at the maximum load, and others."""
    if not run.is_long:
        return steps
    loads_n = np.array([step.load_n for step in steps])
    top = [int(np.nanargmax(loads_n))] if np.isfinite(loads_n).any() else []
    return [steps[k] for k in some_of(len(steps), MOST_ROWS, top)]


def pair_table(run: Run) -> StepTable | None:
    """Return the table of the results that two cameras give together; None without such results.

    The table shows strains in µε, the shift of the specimen's plane in µm and its slopes in degrees, with
    their standard deviations.
    """
    pair = run.pair
    if pair is None:
        return None
    readings, shown = _readings(run), {step.index for step in _shown(run, pair.steps)}
    places = [k for k, step in enumerate(pair.steps) if step.index in shown]
    notes = _notes([pair.declined[k] for k in places])
    rows = []
    for k in places:
        step = pair.steps[k]
        corrected, mark = _corrected(pair, k, notes)
        if corrected:
            corrected.append(f"{fixed(pair.shift_um[k], 2)} ± {fixed(pair.shift_std_um[k], 2)}")
            slopes = zip(pair.slopes_deg[k], pair.slopes_std_deg[k], strict=True)
            corrected += [f"{fixed(slope, 4)} ± {fixed(std, 4)}" for slope, std in slopes]
        rows.append(StepRow(*_head(step, readings), str(pair.points[k]), [], corrected, mark))
    return StepTable(pair.label, [each.heading for each in readings], rows, notes, len(pair.steps))


def _readings(run: Run) -> list[Reading]:
    """Return the device readings that exist for at least one step.

    A rig for tension, for example, gives no angle, and a rotation stage gives no load.
    """
    of_channels = [_of_channel(run, k) for k in range(len(run.steps[0].channels))] if run.steps else []
    return [each for each in (*_READINGS, *of_channels) if any(isfinite(each.value(s)[0]) for s in run.steps)]


def _of_channel(run: Run, k: int) -> Reading:
    """Return the values of the channel with the index `k`."""
    channels = [step.channels[k] for step in run.steps]
    largest = max((abs(each.value) for each in channels if isfinite(each.value)), default=0.0)
    decimals = _CHANNEL_DIGITS - 1 - (floor(log10(largest)) if largest > 0.0 else 0)
    heading = ", ".join(filter(None, (channels[0].name, channels[0].unit)))
    return Reading(heading, lambda step: (step.channels[k].value, step.channels[k].std), max(0, decimals))


def _head(step: RunStep, readings: Sequence[Reading]) -> tuple[int, str, list[str]]:
    """Return the number, the target and the device readings of a step as text for a table row."""
    target = f"{step.target:.6g}{_UNITS.get(step.kind, '')}" if isfinite(step.target) else ""
    return step.index, target, [each.text(step) for each in readings]


def _corrected(series: CameraSeries | PairSeries, k: int, notes: Sequence[Note]) -> tuple[list[str], str]:
    reason = series.declined[k]
    if reason is not None:
        return [], next(note.mark for note in notes if note.reason == reason)
    return _strains(series.corrected[k], series.corrected_std[k]), ""


def _strains(values: Float, stds: Float) -> list[str]:
    return [
        micro_with_std(value, std) if isfinite(std) else micro(value)
        for value, std in zip(values, stds, strict=True)
    ]


def _notes(declined: Sequence[str | None]) -> list[Note]:
    """Return one footnote for each reason why steps were not corrected, in the order of the steps."""
    reasons = list(dict.fromkeys(reason for reason in declined if reason is not None))
    return [Note(_mark(number), reason) for number, reason in enumerate(reasons)]


def _mark(number: int) -> str:
    letters = len(ascii_lowercase)
    return ascii_lowercase[number % letters] * (1 + number // letters)
