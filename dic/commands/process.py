"""The command `dic process`, which evaluates run files and prints tables of the strains."""

from dataclasses import replace
from functools import partial
from pathlib import Path

import click

import dic
from dic import CorrectionSettings, CorrelationSettings, ReferenceSettings, StrainSettings
from dic.commands.options import Chosen, Grouped, all_of, option, options, use
from dic.commands.run_output import RunOutputOptions, problems, read_alignment
from dic.commands.run_regions import RunRegionOptions, region_options
from dic.commands.run_work import RunWork, process_shelf
from dic.commands.settings_file import settings_option, used_settings_file
from dic.commands.shared_options import COMMA_NEEDS, correlation_options, reference_options, strain_options
from dic.commands.worker_options import chosen_workers, worker_options
from dic.pipeline import SurfaceSettings
from dic.shell.console import say
from dic.shell.output_paths import PATH


@options
class RunAlignmentOptions:
    """Options for the alignments of a run's cameras on a rotation stage."""

    alignments: tuple[str, ...] = option(
        "--alignment",
        multiple=True,
        metavar="CAMERA=FILE",
        help="Alignment file of a camera, from an earlier rotation on the same fixture. May be repeated.",
    )
    save_alignment: Path | None = option(
        "--save-alignment", help="Folder for a JSON file of each camera's alignment, solved from a rotation."
    )

    @property
    def files(self) -> list[Path]:
        """The alignment files that the options name."""
        return [Path(text.partition("=")[2]) for text in self.alignments]

    def settings(self, assumed: Chosen[CorrectionSettings]) -> CorrectionSettings:
        """Return the settings of the corrections, with the alignments."""
        _, *alignments = all_of(
            assumed.settings, *(partial(read_alignment, text) for text in self.alignments)
        )
        return assumed.settings(alignments=dict(alignments))


@click.command(cls=Grouped)
@click.argument("runs", metavar="RUN...", type=PATH, nargs=-1, required=True)
@settings_option
@worker_options
@use("surface", SurfaceSettings, title="Motion")
@correlation_options
@reference_options
@strain_options
@region_options
@use(
    "assumed",
    CorrectionSettings,
    title="Motion",
    only=(
        *("poisson_ratio", "shift_std_um", "tilt_axis_mm", "thickness_mm", "fixed_face"),
        *("grid_made", "scale_ratio_std", "skew_std", "flatness_std_mm"),
    ),
)
@use("motion", RunAlignmentOptions)
@use("outputs", RunOutputOptions, needs=COMMA_NEEDS)
def process(
    runs: tuple[Path, ...],
    surface: Chosen[SurfaceSettings],
    correlation: Chosen[CorrelationSettings],
    references: Chosen[ReferenceSettings],
    strain: Chosen[StrainSettings],
    region: RunRegionOptions,
    assumed: Chosen[CorrectionSettings],
    motion: RunAlignmentOptions,
    outputs: RunOutputOptions,
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
    listed = dic.pipeline.list_run_files(runs)
    for earlier, later in listed.continued.items():
        say(f"{earlier} is left out, because {later} continues it and contains its steps")
    paths = listed.paths
    several = len(paths) > 1 or any(run.is_dir() for run in runs)
    settings, rule, how, source, correcting, gauges, place, _ = all_of(
        correlation.settings,
        references.settings,
        strain.settings,
        partial(region.source, paths[0]),
        partial(motion.settings, assumed),
        outputs.gauges,
        surface.settings,
        partial(outputs.require_several, len(paths)) if several else lambda: None,
    )
    inputs = [used_settings_file(), *motion.files, *region.files, outputs.gauges_file]
    work = RunWork(
        settings,
        how,
        correcting,
        rule.incremental,
        place.plate_mm,
        gauges,
        inputs,
        motion.save_alignment,
        outputs,
    )
    if several:
        work.require_own_places(paths)
        outputs.make_folder_of_results()
    with chosen_workers(settings) as workers:
        if several:
            status = process_shelf(work, [replace(source, path=run) for run in paths], workers)
        else:
            status = problems(str(source.path), work.process(source, workers))
    click.get_current_context().exit(status)
