"""Writes the output files of a run in addition to the result file, and ends the command with its status."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from operator import attrgetter
from pathlib import Path
from typing import Any

import dic
from dic.commands.gauge_text import gauge_lines, gauges_dict
from dic.commands.options import option, options
from dic.commands.run_table import as_dict
from dic.commands.shared_options import comma, csv, fields_from, force, gauges, json_file
from dic.errors import CorrelationError, OutputError
from dic.files import some_sentences, write_text
from dic.shell.console import fail, say
from dic.shell.output_paths import require_places, same_or_new

_ALL_IN = "--json has"


@options
class RunOutputOptions:
    """Options that name the output files of `dic process`."""

    output: Path | None = option(
        "-o",
        "--output",
        common=True,
        help="Result file; for several runs a folder. Default: RUN with the ending .results.h5.",
    )
    report_file: Path | None = option("--report", help="HTML file for a report.", common=True)
    csv_folder: Path | None = csv()
    gauges_file: Path | None = gauges()
    decimal_comma: bool = comma()
    json_file: Path | None = json_file()
    force: bool = force()
    fields_from: Path | None = fields_from()

    def place(self, output: Path, inputs: Iterable[Path | None] = ()) -> dic.results.ResultPlace:
        """Return the place of the result file, and whether existing results may be replaced or used.

        The `inputs` are the files with settings; None means "no file".
        """
        known = tuple(path for path in inputs if path is not None)
        return dic.results.ResultPlace(output, self.force, fields_from=self.fields_from, inputs=known)

    def require_several(self, count: int) -> None:
        """Raise an `OutputError` if an option names a file of one run, because there are several runs."""
        for name, path in (
            ("--report", self.report_file),
            ("--json", self.json_file),
            ("--fields-from", self.fields_from),
        ):
            if path is not None:
                remedy = f"leave out {name}, or process the runs one by one"
                raise OutputError("settings", name, "one run", f"{count} runs", remedy)

    def make_folder_of_results(self) -> None:
        """Make the folder of `-o` for the results of several runs."""
        if self.output is not None:
            _make_folder(self.output)

    def gauges(self) -> tuple[dic.gauges.Gauge, ...]:
        """Return the gauges of `--gauges`; none without this option."""
        return () if self.gauges_file is None else dic.read_gauges(self.gauges_file)

    def read_gauges(
        self, result: dic.pipeline.RunResult, gauges: tuple[dic.gauges.Gauge, ...]
    ) -> dict[str, Any]:
        """Read gauges in all steps, print and write the readings, and return them for JSON."""
        found = dic.measure_gauges(result, gauges)
        for line in gauge_lines(found):
            say(line)
        if self.csv_folder is not None:
            with same_or_new(self.csv_folder, replace=self.force or not result.known) as folder:
                dic.gauges.write_gauge_table(
                    found, folder / dic.derived.GAUGE_FILE, decimal_comma=self.decimal_comma
                )
        return gauges_dict(found)

    def require_places(
        self,
        read: Sequence[Path | None],
        output: Path | None,
        alignments: Path | None = None,
        *,
        result_may_stand: bool = False,
    ) -> None:
        """Raise an error if an output file of the run cannot be written; make the folders of outputs.

        `result_may_stand` is True if `process_run` decides whether an existing result file can be used.
        """
        written = [] if alignments is None else [*alignments.glob("*.alignment.json")]

        # The names of the tables of points follow from the steps of the run.
        tables = [] if self.csv_folder is None else [*self.csv_folder.glob("*.csv")]
        places = [output, self.report_file, self.json_file, *written, *tables]
        earlier = [] if output is None else dic.results.outputs_of(output)
        if output is not None and result_may_stand:
            if output.exists() and output.resolve() not in earlier:
                # Either the run is known before, and `same_or_new` compares its files with those that are
                # there, or `process_run` refuses to replace the result file.
                earlier += [*written, *tables]
            earlier.append(output)
        require_places(read, places, force=self.force, replaceable=earlier)
        for folder in (alignments, self.csv_folder):
            if folder is not None:
                _make_folder(folder)

    def write(self, result: dic.pipeline.RunResult, gauges: tuple[dic.gauges.Gauge, ...] = ()) -> None:
        """Write the output files other than the result file."""
        if self.csv_folder is not None:
            with same_or_new(self.csv_folder, replace=self.force or not result.known) as folder:
                dic.derived.write_run_tables(result, folder, decimal_comma=self.decimal_comma)
            say(f"tables: {self.csv_folder / dic.results.STRAIN_FILE} and one of points for each image")
        if self.report_file is not None:
            dic.write_report([result], self.report_file)
            say(f"report: {self.report_file}")
        content = {} if self.json_file is None else as_dict(result)
        try:
            content |= self.read_gauges(result, gauges) if gauges else {}
        finally:
            # If a gauge does not fit the results, all other outputs are written nevertheless.
            if self.json_file is not None:
                write_text(self.json_file, json.dumps(content, indent=1))


def problems(run: str, result: dic.pipeline.RunResult) -> int:
    """Print the problems of a run's steps, and return the exit status: 0, 1 if poor, 2 if steps failed."""
    failures = [failure for camera in result.cameras for failure in camera.failures]
    bad = [
        f"{run}: {camera.camera}, {label}: measured, but {objection}"
        for camera in result.cameras
        for label, objection in map(attrgetter("label", "objection"), camera.measurements)
        if objection is not None
    ]
    for sentence in some_sentences(failures, _ALL_IN) + some_sentences(bad, _ALL_IN):
        fail(sentence)
    return 2 if failures else 1 if bad else 0


def read_alignment(text: str) -> tuple[str, dic.out_of_plane.Alignment]:
    """Return camera and alignment from the value of `--alignment`."""
    camera, equals, file = text.partition("=")
    if camera and equals and file:
        return camera, dic.out_of_plane.load_alignment(Path(file))
    raise CorrelationError(
        "settings",
        "alignment",
        "CAMERA=FILE",
        text,
        "name the camera that the alignment belongs to: --alignment on_axis=FILE",
    )


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(
            str(folder),
            "write results",
            "a folder that can be made",
            str(error.strerror or error),
            "name another place",
        ) from error


def save_alignments(folder: Path, result: dic.pipeline.RunResult, *, replace: bool) -> None:
    """Write the alignment of each camera, if it was solved from the images of a rotation."""
    solved = {f"{name}.alignment.json": own.alignment for name, own in result.corrections.cameras.items()}
    with same_or_new(folder, replace=replace) as place:
        for name, alignment in solved.items():
            if alignment is not None:
                dic.out_of_plane.save_alignment(alignment, place / name)
    for name, alignment in solved.items():
        if alignment is not None:
            say(f"alignment: {folder / name}")
