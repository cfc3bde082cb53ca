"""The command `dic process`, which evaluates run files and prints tables of the strains."""

from dataclasses import dataclass, replace
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
from dic.commands.run_output import OutputOptions, problems, read_alignment
from dic.commands.run_regions import RegionOptions, region_options
from dic.commands.settings_file import settings_option, used_settings_file
from dic.commands.worker_options import chosen_workers, worker_options
from dic.shell.console import say
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
@click.argument("runs", metavar="RUN...", type=_FILE, nargs=-1, required=True)
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
    click.option(
        "-o",
        "--output",
        type=_FILE,
        help="Result file; for several runs a folder. Default: RUN with the ending .results.h5.",
    ),
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
    runs: tuple[Path, ...],
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

    Several RUN files, or folders of run files, are processed one after the other. Each has a result file of
    its own. Finished runs are not correlated again, and a run that cannot be processed does not end the
    others. A closing table lists all runs.

    Exit status: 0 if all steps are measured well, 1 if a step is measured poorly, 2 if a step or a run cannot
    be measured.
    """
    from dic import Series
    from dic.commands.run_work import RunWork, process_shelf
    from dic.pipeline.run_source import list_run_files

    listed = list_run_files(runs)
    for earlier, later in listed.continued.items():
        say(f"{earlier} is left out, because {later} continues it and contains its steps")
    paths = listed.paths
    several = len(paths) > 1 or any(run.is_dir() for run in runs)
    settings, _, how, source, correcting, gauges, _ = all_of(
        correlation.settings,
        partial(Series.require_incremental, incremental),
        strain.settings,
        partial(region.source, paths[0]),
        motion.settings,
        outputs.gauges,
        partial(outputs.require_several, len(paths)) if several else lambda: None,
    )
    inputs = [used_settings_file(), *motion.files, *region.files, outputs.gauges_file]
    work = RunWork(
        settings, how, correcting, incremental, plate_mm, gauges, inputs, motion.save_alignment, outputs
    )
    if several:
        work.require_own_places(paths)
        outputs.make_folder_of_results()
    with chosen_workers() as workers:
        if several:
            status = process_shelf(work, [replace(source, path=run) for run in paths], workers)
        else:
            status = problems(str(source.path), work.process(source, workers))
    click.get_current_context().exit(status)
