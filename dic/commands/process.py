"""The command `dic process`, which evaluates a run file and prints a table of the strains."""

import json
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dic.commands.correlation_options import (
    COMMA_NEEDS,
    StrainOptions,
    comma_option,
    csv_option,
    gauges_option,
    hinge_mm,
    hinge_option,
    incremental_option,
    poisson_option,
    shape_option,
    shift_option,
    smoothing_option,
    smoothing_px,
    step_option,
    strain_options,
    subset_option,
)
from dic.commands.option_groups import all_of, option_group
from dic.files.writing import write_text
from dic.shell.output_paths import FORCE, require_places

if TYPE_CHECKING:
    from dic import Alignment, CorrectionSettings, CorrelationSettings, Gauge, RunResult

_FILE = click.Path(path_type=Path)


@dataclass(frozen=True)
class CorrelationOptions:
    """Correlation options of `dic process`."""

    subset: int
    step: int
    shape: str
    incremental: str
    smoothing: str

    def settings(self) -> "CorrelationSettings":
        """Return the options as `CorrelationSettings`."""
        from dic import CorrelationSettings

        return CorrelationSettings(
            subset_px=self.subset,
            step_px=self.step,
            shape=self.shape,
            smoothing_px=smoothing_px(self.smoothing),
        )

    def check(self) -> None:
        """Raise an error if the value of `--incremental` is unknown."""
        from dic import Series

        Series.require_incremental(self.incremental)


@dataclass(frozen=True)
class MotionOptions:
    """Options for the correction of motion out of the grid's plane."""

    poisson_ratio: float
    shift_std_um: float | None
    hinge_text: str | None
    alignments: tuple[str, ...]
    save_alignment: Path | None

    def settings(self) -> "CorrectionSettings":
        """Return the options as `CorrectionSettings`."""
        from dic import CorrectionSettings

        _, hinge, *alignments = all_of(
            lambda: CorrectionSettings(self.poisson_ratio, shift_std_um=self.shift_std_um),
            partial(hinge_mm, self.hinge_text),
            *(partial(_read_alignment, text) for text in self.alignments),
        )
        return CorrectionSettings(self.poisson_ratio, dict(alignments), self.shift_std_um, hinge)


@dataclass(frozen=True)
class OutputOptions:
    """Options that name the output files of `dic process`."""

    output: Path | None
    report_file: Path | None
    csv_folder: Path | None
    gauges_file: Path | None
    decimal_comma: bool
    json_file: Path | None
    force: bool

    def gauges(self) -> "tuple[Gauge, ...]":
        """Return the gauges of `--gauges`; none without this option."""
        from dic import read_gauges

        return () if self.gauges_file is None else read_gauges(self.gauges_file)

    def read_gauges(self, result: "RunResult", gauges: "tuple[Gauge, ...]") -> dict[str, Any]:
        """Read gauges in all steps, print and write the readings, and return them for JSON."""
        from dic import measure_gauges, write_gauge_table
        from dic.commands.gauge_text import gauge_lines, gauges_dict
        from dic.pipeline.series_files import GAUGE_FILE
        from dic.shell.console import say

        found = measure_gauges(result, gauges)
        for line in gauge_lines(found):
            say(line)
        if self.csv_folder is not None:
            write_gauge_table(found, self.csv_folder / GAUGE_FILE, decimal_comma=self.decimal_comma)
        return gauges_dict(found)

    def require_places(self, run: Path, output: Path, alignments: Path | None) -> None:
        """Raise an error if an output file of the run cannot be written; make the folders of outputs."""
        written = [] if alignments is None else [*alignments.glob("*.alignment.json")]
        from dic.results.unfinished import outputs_of

        # The names of the tables of points follow from the steps of the run.
        tables = [] if self.csv_folder is None else [*self.csv_folder.glob("*.csv")]
        places = [output, self.report_file, self.json_file, *written, *tables]
        require_places([run, self.gauges_file], places, force=self.force, replaceable=outputs_of(output))
        for folder in (alignments, self.csv_folder):
            if folder is not None:
                _make_folder(folder)


@click.command()
@click.argument("run", type=_FILE)
@click.option(
    "--plate-mm",
    type=float,
    help="Distance of the specimen's surface behind the grid's lines, such as the thickness of the grid's"
    " plate. Default: the value in the run file, otherwise 0.",
)
@option_group(
    "correlation",
    CorrelationOptions,
    subset_option,
    step_option,
    shape_option,
    incremental_option,
    smoothing_option,
)
@strain_options
@option_group(
    "motion",
    MotionOptions,
    poisson_option,
    shift_option,
    hinge_option,
    click.option(
        "--alignment",
        "alignments",
        multiple=True,
        metavar="CAMERA=FILE",
        help="Alignment file of a camera, from an earlier rotation on the same fixture. May be repeated.",
    ),
    click.option(
        "--save-alignment", type=_FILE, help="Folder for JSON files of the alignments that a rotation gives."
    ),
)
@option_group(
    "outputs",
    OutputOptions,
    click.option("-o", "--output", type=_FILE, help="Result file. Default: RUN with the ending .results.h5."),
    click.option("--report", "report_file", type=_FILE, help="HTML file for a report."),
    csv_option,
    gauges_option,
    comma_option,
    click.option("--json", "json_file", type=_FILE, help="JSON file of the printed results."),
    FORCE,
    needs=COMMA_NEEDS,
)
def process(
    run: Path,
    plate_mm: float | None,
    correlation: CorrelationOptions,
    strain: StrainOptions,
    motion: MotionOptions,
    outputs: OutputOptions,
) -> None:
    """Calibrate every camera of a RUN file, correlate the images of every step, and print the strains.

    The strains are raw, calibrated, and corrected for motion of the specimen out of the grid's plane. If two
    cameras recorded a tension test, a further correction uses both cameras together.

    Exit status: 0 if all steps are measured well, 1 if a step is measured poorly, 2 if a step cannot be
    measured.
    """
    from dic import process_run, write_report
    from dic.commands.run_table import as_dict, table
    from dic.pipeline.run_tables import write_run_tables
    from dic.results.strain_table import STRAIN_FILE
    from dic.shell.console import fail, say
    from dic.shell.progress import progress

    settings, _, how, correcting, gauges = all_of(
        correlation.settings, correlation.check, strain.settings, motion.settings, outputs.gauges
    )
    output = outputs.output or run.with_suffix(".results.h5")
    outputs.require_places(run, output, motion.save_alignment)
    with progress("correlating") as bar:
        result = process_run(
            run,
            settings,
            how,
            correcting=correcting,
            incremental=correlation.incremental,
            plate_mm=plate_mm,
            on_image=bar.advance,
            on_count=bar.expect,
            output=output,
        )
    say(table(result))
    for camera in result.cameras:
        if camera.specimen is None:
            say(f"{camera.camera}: no specimen was found by its speckles; points cover the calibrated area")
        elif not camera.specimen.is_whole:
            say(f"{camera.camera}, calibrated part: {camera.specimen}")
    say(f"results: {output}")
    if motion.save_alignment is not None:
        _save_alignments(motion.save_alignment, result)
    if outputs.csv_folder is not None:
        write_run_tables(result, outputs.csv_folder, decimal_comma=outputs.decimal_comma)
        say(f"tables: {outputs.csv_folder / STRAIN_FILE} and one of points for each image")
    if outputs.report_file is not None:
        write_report([result], outputs.report_file)
        say(f"report: {outputs.report_file}")
    content = as_dict(result)
    try:
        content |= outputs.read_gauges(result, gauges) if gauges else {}
    finally:
        # A gauge that does not fit the results takes nothing else away.
        if outputs.json_file is not None:
            write_text(outputs.json_file, json.dumps(content, indent=1))
    failures = [failure for camera in result.cameras for failure in camera.failures]
    bad = [
        f"{run}: {camera.camera}, {measurement.label}: measured, but {measurement.objection}"
        for camera in result.cameras
        for measurement in camera.measurements
        if not measurement.good
    ]
    for sentence in failures + bad:
        fail(sentence)
    click.get_current_context().exit(2 if failures else 1 if bad else 0)


def _read_alignment(text: str) -> "tuple[str, Alignment]":
    from dic import CorrelationError, load_alignment

    camera, equals, file = text.partition("=")
    if camera and equals and file:
        return camera, load_alignment(Path(file))
    raise CorrelationError(
        "settings",
        "alignment",
        "CAMERA=FILE",
        text,
        "name the camera that the alignment belongs to: --alignment on_axis=FILE",
    )


def _make_folder(folder: Path) -> None:
    from dic import OutputError

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


def _save_alignments(folder: Path, result: "RunResult") -> None:
    from dic import save_alignment
    from dic.shell.console import say

    for camera, corrections in result.corrections.cameras.items():
        if corrections.alignment is not None:
            path = folder / f"{camera}.alignment.json"
            save_alignment(corrections.alignment, path)
            say(f"alignment: {path}")
