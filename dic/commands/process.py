"""The command `dic process`, which evaluates a run file and prints a table of the strains."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from dic.commands.correlation_options import (
    COMMA_NEEDS,
    CorrelationOptions,
    StrainOptions,
    comma_option,
    correlation_options,
    csv_option,
    fields_from_option,
    gauges_option,
    hinge_mm,
    hinge_option,
    incremental_option,
    poisson_option,
    shift_option,
    strain_options,
)
from dic.commands.option_groups import all_of, option_group
from dic.commands.run_output import OutputOptions, end_run, read_alignment, save_alignments
from dic.commands.run_regions import RegionOptions, region_options
from dic.commands.settings_file import settings_option, used_settings_file
from dic.commands.worker_options import chosen_workers, worker_options
from dic.shell.output_paths import FORCE

if TYPE_CHECKING:
    from dic import CorrectionSettings

_FILE = click.Path(path_type=Path)


@dataclass(frozen=True)
class MotionOptions:
    """Options for the correction of motion out of the grid's plane."""

    poisson_ratio: float
    shift_std_um: float | None
    hinge_text: str | None
    alignments: tuple[str, ...]
    save_alignment: Path | None

    @property
    def files(self) -> list[Path]:
        """The alignment files that the options name."""
        return [Path(text.partition("=")[2]) for text in self.alignments]

    def settings(self) -> "CorrectionSettings":
        """Return the options as `CorrectionSettings`."""
        from dic import CorrectionSettings

        _, hinge, *alignments = all_of(
            lambda: CorrectionSettings(self.poisson_ratio, shift_std_um=self.shift_std_um),
            partial(hinge_mm, self.hinge_text),
            *(partial(read_alignment, text) for text in self.alignments),
        )
        return CorrectionSettings(self.poisson_ratio, dict(alignments), self.shift_std_um, hinge)


@click.command()
@click.argument("run", type=_FILE)
@settings_option
@worker_options
@click.option(
    "--plate-mm",
    type=float,
    help="Distance of the specimen's surface behind the grid's lines, such as the thickness of the grid's"
    " plate. Default: the value in the run file, otherwise 0.",
)
@correlation_options
@incremental_option
@strain_options
@region_options
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
        "--save-alignment",
        type=_FILE,
        help="Folder for a JSON file of each camera's alignment, solved from a rotation.",
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
    fields_from_option,
    needs=COMMA_NEEDS,
)
def process(
    run: Path,
    plate_mm: float | None,
    correlation: CorrelationOptions,
    incremental: str,
    strain: StrainOptions,
    region: RegionOptions,
    motion: MotionOptions,
    outputs: OutputOptions,
) -> None:
    """Calibrate every camera of a RUN file, correlate the images of every step, and print the strains.

    The strains are raw, calibrated, and corrected for motion of the specimen out of the grid's plane. If two
    cameras recorded a tension test, a further correction uses both cameras together.

    Exit status: 0 if all steps are measured well, 1 if a step is measured poorly, 2 if a step cannot be
    measured.
    """
    from dic import Series, process_run
    from dic.commands.run_table import table
    from dic.shell.console import say
    from dic.shell.progress import progress

    settings, _, how, source, correcting, gauges = all_of(
        correlation.settings,
        partial(Series.require_incremental, incremental),
        strain.settings,
        partial(region.source, run),
        motion.settings,
        outputs.gauges,
    )
    output = outputs.output or run.with_suffix(".results.h5")
    settings_files = [used_settings_file(), *motion.files, *region.files, outputs.gauges_file]
    read = [run, *settings_files, outputs.fields_from if outputs.fields_from != output else None]
    outputs.require_places(read, output, motion.save_alignment, result_may_stand=True)
    with progress("correlating") as bar, chosen_workers() as workers:

        def count(total: int) -> None:
            bar.expect(total)
            bar.advance()

        result = process_run(
            source,
            settings,
            how,
            correcting=correcting,
            incremental=incremental,
            plate_mm=plate_mm,
            on_image=count,
            output=outputs.place(output, settings_files),
            workers=workers,
        )
    if result.note:
        say(result.note)
    say(table(result))
    for camera in [] if result.note else result.cameras:
        if camera.camera in source.regions:
            continue
        if camera.specimen is None:
            say(f"{camera.camera}: no specimen was found by its speckles; points cover the calibrated area")
        elif not camera.specimen.is_whole:
            say(f"{camera.camera}, calibrated part: {camera.specimen}")
    say(f"results: {output}")
    if motion.save_alignment is not None:
        save_alignments(motion.save_alignment, result)
    outputs.write(result, gauges)
    end_run(str(run), result)
