"""The command `dic export`, which writes the fields of results in the formats of other programs."""

import json
from pathlib import Path

import click

import dic
from dic.commands.options import telling
from dic.exports import EXPORTS
from dic.files import write_text
from dic.shell.console import fail, say
from dic.shell.output_paths import FORCE, PATH, require_places
from dic.shell.progress import progress


@click.command()
@click.argument("results", type=PATH)
@click.argument("formats", metavar="FORMAT...", nargs=-1, required=True)
@click.option("-o", "--output", type=PATH, required=True, help="Folder; each format gets a folder in it.")
@click.option("--camera", help="Camera of a run. Default: all cameras.")
@click.option(
    "--raw-strain",
    is_flag=True,
    help="Also write the local strain from displacements in px, raw_exx …, beside the calibrated one.",
)
@click.option(
    "--decimal-comma",
    is_flag=True,
    help="Write CSV files with decimal commas, and semicolons between the cells.",
)
@click.option("--json", "json_file", type=PATH, help="JSON file of the list of written images.")
@FORCE
@telling(formats=", ".join(f"{name} ({each.about})" for name, each in EXPORTS.items()))
def export(
    results: Path,
    formats: tuple[str, ...],
    output: Path,
    camera: str | None,
    raw_strain: bool,
    decimal_comma: bool,
    json_file: Path | None,
    force: bool,
) -> None:
    """Write the fields of all images in RESULTS for other programs: ParaView, MATLAB, a spreadsheet, Python.

    RESULTS is a result file of `dic correlate` or `dic process`. Only one image at a time is in memory. Each
    FORMAT is one of: {formats}.

    Exit status: 0 if everything that was measured is written, 2 if not.
    """
    require_places([results], [json_file], force=force)
    with progress("exporting") as bar:
        done = dic.export_results(
            results,
            output,
            formats,
            camera=camera,
            raw_strain=raw_strain,
            decimal_comma=decimal_comma,
            replace=force,
            on_image=bar.advance_of,
        )
    for name, folder in done.folders.items():
        images = f"{len(done.images)} image{'s' if len(done.images) > 1 else ''}"
        say(f"{name}: {folder}, {images}")
    if json_file is not None:
        write_text(json_file, json.dumps(done.as_dict(), indent=1))
    for sentence in done.failures:
        fail(f"not exported, because it was not measured: {sentence}")
