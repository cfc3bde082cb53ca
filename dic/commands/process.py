"""`dic process`: run files in, results and the paper's table out."""

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from dic.commands.correlation_options import StrainOptions, strain_options

if TYPE_CHECKING:
    from dic.out_of_plane.alignment import Alignment
    from dic.pipeline.run import RunResult

_FILE = click.Path(path_type=Path)


@click.command()
@click.argument("run", type=_FILE)
@click.option("-o", "--output", type=_FILE, help="Result file. Default: RUN with the ending .results.h5.")
@click.option("--report", "report_file", type=_FILE, help="Also write the report, one HTML file.")
@click.option("--subset", default=31, show_default=True, help="Width of the subsets, odd, px.")
@click.option("--step", default=10, show_default=True, help="Distance of the points, px.")
@click.option("--shape", default="quadratic", show_default=True, help="Shape function, affine or quadratic.")
@click.option(
    "--incremental",
    default="auto",
    show_default=True,
    help="New reference: auto (when the correlation drops), never, or always (each image before).",
)
@strain_options
@click.option("--poisson-ratio", default=0.33, show_default=True, help="Of the specimen, for its bending.")
@click.option(
    "--alignment",
    "alignments",
    multiple=True,
    metavar="CAMERA=FILE",
    help="Correct a rotation by the alignment of an earlier one on the same fixture. May be repeated.",
)
@click.option("--save-alignment", type=_FILE, help="Folder for the alignments that a rotation tells, JSON.")
@click.option("--json", "json_file", type=_FILE, help="What is printed, for programs.")
@click.pass_context
def process(
    context: click.Context,
    run: Path,
    output: Path | None,
    report_file: Path | None,
    subset: int,
    step: int,
    shape: str,
    incremental: str,
    strain: StrainOptions,
    poisson_ratio: float,
    alignments: tuple[str, ...],
    save_alignment: Path | None,
    json_file: Path | None,
) -> None:
    """Calibrate every camera of a RUN file, correlate every step, and give its strains.

    Raw, calibrated, and corrected for a specimen that left the grid's plane. Tension that two cameras saw is
    corrected by both together, too.

    Status: 0, 1 if a step was measured badly, 2 if one could not be measured.
    """
    from dic.commands.run_table import as_dict, table
    from dic.correlation.settings import CorrelationSettings
    from dic.pipeline.run import process_run
    from dic.pipeline.run_corrections import CorrectionSettings
    from dic.pipeline.run_result_file import save_run_result
    from dic.report import write_report
    from dic.shell.console import fail, say
    from dic.shell.output_paths import require_places
    from dic.shell.progress import progress

    settings = CorrelationSettings(subset_px=subset, step_px=step, shape=shape)
    correcting = CorrectionSettings(poisson_ratio, _read_alignments(alignments))
    output = output or run.with_suffix(".results.h5")
    require_places([run], [output, report_file, json_file])
    if save_alignment is not None:
        _make_folder(save_alignment)
    with progress("correlating") as bar:
        result = process_run(
            run,
            settings,
            strain.settings(),
            correcting=correcting,
            incremental=incremental,
            on_image=bar.advance,
            on_count=bar.expect,
        )
    save_run_result(result, output)
    say(table(result))
    say(f"results: {output}")
    if save_alignment is not None:
        _save_alignments(save_alignment, result)
    if report_file is not None:
        write_report([result], report_file)
        say(f"report: {report_file}")
    if json_file is not None:
        json_file.write_text(json.dumps(as_dict(result), indent=1), encoding="utf-8")
    failures = [failure for camera in result.cameras for failure in camera.failures]
    bad = [
        f"{run}: {camera.camera}, {measurement.label}: measured, but {measurement.objection}"
        for camera in result.cameras
        for measurement in camera.measurements
        if not measurement.good
    ]
    for sentence in failures + bad:
        fail(sentence)
    context.exit(2 if failures else 1 if bad else 0)


def _read_alignments(texts: tuple[str, ...]) -> "dict[str, Alignment]":
    from dic.errors import CorrelationError
    from dic.out_of_plane.alignment import load_alignment

    alignments = {}
    for text in texts:
        camera, equals, file = text.partition("=")
        if not (camera and equals and file):
            raise CorrelationError(
                "settings", "alignment", "CAMERA=FILE", text, "name the camera that the alignment belongs to"
            )
        alignments[camera] = load_alignment(Path(file))
    return alignments


def _make_folder(folder: Path) -> None:
    from dic.errors import OutputError

    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(
            str(folder),
            "save alignments",
            "a folder that can be made",
            str(error.strerror or error),
            "name another place",
        ) from error


def _save_alignments(folder: Path, result: "RunResult") -> None:
    from dic.out_of_plane.alignment import save_alignment
    from dic.shell.console import say

    for camera, corrections in result.corrections.cameras.items():
        if corrections.alignment is not None:
            path = folder / f"{camera}.alignment.json"
            save_alignment(corrections.alignment, path)
            say(f"alignment: {path}")
