"""The processing of one run file, or of a shelf of run files, with the options of `dic process`."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import dic
from dic.commands.run_output import RunOutputOptions, problems, save_alignments
from dic.commands.run_table import table
from dic.errors import MeasurementError, OutputError, WorkerError
from dic.shell.console import COULD_NOT, fail, say, sentence_of
from dic.shell.progress import progress

MEASURED, STRAIN_ANEW, KNOWN = "measured", "strain anew", "known before"
NOT_PROCESSED, NOT_BEGUN = "not processed", "not begun"
GOES_ON = "interrupted before the end; give the same command again to go on after the last finished image"


@dataclass(frozen=True)
class RunWork:
    """How runs are processed: the values of the options of `dic process`, except the run files."""

    settings: dic.CorrelationSettings
    strain: dic.StrainSettings
    correcting: dic.CorrectionSettings
    incremental: str
    plate_mm: float | None
    gauges: tuple[dic.gauges.Gauge, ...]
    inputs: Sequence[Path | None]
    """Files with settings, regions and gauges; None means "no file"."""
    alignments: Path | None
    """Folder for alignments."""
    outputs: RunOutputOptions
    of_several: bool = False
    """True for one run of several. Of such a run, known results are not printed again."""

    def of_run(self, run: Path) -> RunWork:
        """Return the work for one run of several: its outputs are in folders of their own."""
        outputs = self.outputs
        own = replace(
            outputs,
            output=None if outputs.output is None else outputs.output / f"{run.stem}{_ENDING}",
            csv_folder=None if outputs.csv_folder is None else outputs.csv_folder / run.stem,
        )
        alignments = None if self.alignments is None else self.alignments / run.stem
        return replace(self, outputs=own, alignments=alignments, of_several=True)

    def require_own_places(self, runs: Sequence[Path]) -> None:
        """Raise an `OutputError` if outputs of a run would replace another run, or outputs of another run."""
        taken = {_place(run): run for run in runs}
        for run in runs:
            own = self.of_run(run)
            tables = own.outputs.csv_folder
            for path in [_place(path) for path in (own.output(run), tables, own.alignments) if path]:
                if (other := taken.setdefault(path, run)) != run:
                    expected, got = "a place of its own for each run", f"one place for {other} and {run}"
                    remedy = "process one of them alone, with another place for its outputs"
                    raise OutputError(path, "write results", expected, got, remedy)

    def output(self, run: Path) -> Path:
        """Return the path of the result file of a run."""
        return self.outputs.output or run.with_suffix(_ENDING)

    def process(
        self,
        source: dic.pipeline.RunSource,
        workers: dic.workers.Workers | None,
        what: str = "correlating",
    ) -> dic.pipeline.RunResult:
        """Process a run, print its table, and write its files.

        Raises `MeasurementError` if the run cannot be processed.
        """
        run, outputs = Path(source.path), self.outputs
        output = self.output(run)
        read = [run, *self.inputs, outputs.fields_from if outputs.fields_from != output else None]
        outputs.require_places(read, output, self.alignments, result_may_stand=True)
        with progress(what) as bar:
            try:
                result = dic.process_run(
                    source,
                    self.settings,
                    self.strain,
                    correcting=self.correcting,
                    incremental=self.incremental,
                    plate_mm=self.plate_mm,
                    on_image=bar.advance_of,
                    output=outputs.place(output, self.inputs),
                    workers=workers,
                )
            except KeyboardInterrupt as error:
                raise KeyboardInterrupt(GOES_ON) from error
        if result.note:
            say(result.note)
        if not (result.known and self.of_several):
            say(table(result))
        for line in [] if result.note else _specimens(result, source):
            say(line)
        say(f"results: {output}")
        if self.alignments is not None:
            save_alignments(self.alignments, result, replace=outputs.force or not result.known)
        outputs.write(result, self.gauges)
        return result


_ENDING = ".results.h5"


def _place(path: Path) -> str:
    """Return a text that is equal for all names of the same place."""
    return os.path.normcase(os.path.realpath(path))


def process_shelf(
    work: RunWork, sources: Sequence[dic.pipeline.RunSource], workers: dic.workers.Workers | None
) -> int:
    """Process several runs one after the other, print a closing table, and return the exit status.

    A run that cannot be processed does not end the others. The status is the highest status of all runs.

    Raises `WorkerError` if the workers cannot go on. The table then also has the runs that were not begun.
    """
    table = {Path(source.path): (NOT_BEGUN, "") for source in sources}
    status = 0
    try:
        for number, source in enumerate(sources, 1):
            run = Path(source.path)
            say(f"run {number} of {len(sources)}: {run}")
            table[run] = NOT_PROCESSED, ""
            try:
                # The name of the run is in the line above. A long name would leave no room for the bar.
                what = f"run {number} of {len(sources)}"
                result = work.of_run(run).process(source, workers, what)
            except WorkerError:
                raise
            except (MeasurementError, OSError) as error:
                fail(sentence_of(error))
                status = COULD_NOT
                continue
            state = KNOWN if result.known else STRAIN_ANEW if result.note else MEASURED
            table[run] = state, _counts(result)
            status = max(status, problems(str(run), result))
    finally:
        say(_closing_table(table))
    return status


def _specimens(result: dic.pipeline.RunResult, source: dic.pipeline.RunSource) -> list[str]:
    """Return lines about where the points of the cameras lie that measure the specimen."""
    lines = []
    for camera in result.cameras:
        if camera.camera in source.regions:
            continue
        if camera.specimen is None:
            lines.append(
                f"{camera.camera}: no specimen was found by its speckles; points cover the calibrated area"
            )
        elif not camera.specimen.is_whole:
            lines.append(f"{camera.camera}, calibrated part: {camera.specimen}")
    return lines


def _counts(result: dic.pipeline.RunResult) -> str:
    images = sum(len(camera.measurements) for camera in result.cameras)
    failed = sum(len(camera.failures) for camera in result.cameras)
    poor = sum(not measurement.good for camera in result.cameras for measurement in camera.measurements)
    parts = [(images, "images"), (poor, "poor"), (failed, "failed")]
    return ", ".join(f"{count} {name}" for count, name in parts if count or name == "images")


def _closing_table(table: dict[Path, tuple[str, str]]) -> str:
    # Long names are at the end of the lines, so that the columns stay below each other on every terminal.
    state_width, counts_width = (max(len(cells[k]) for cells in table.values()) for k in (0, 1))
    states = [state for state, _ in table.values()]
    counted = [f"{states.count(state)} {state}" for state in dict.fromkeys(states)]
    lines = [f"{len(table)} {'run' if len(table) == 1 else 'runs'}: {', '.join(counted)}"]
    for path, (state, counts) in table.items():
        lines.append(f"  {state:{state_width}}  {counts:{counts_width}}  {path}")
    return "\n".join(lines)
