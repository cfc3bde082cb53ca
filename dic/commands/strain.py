"""The command `dic strain`, which computes strain again from the displacement fields of a result file."""

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import click
from click.core import ParameterSource

import dic
from dic import CorrectionSettings, Motion, StrainSettings
from dic.calibration import GridAccuracy
from dic.commands.options import Chosen, Grouped, all_of, as_in_results, gather, option, options, use
from dic.commands.run_output import RunOutputOptions, problems, read_alignment
from dic.commands.run_table import table
from dic.commands.series_evaluation import SeriesEvaluation, SeriesPlaces, end
from dic.commands.series_options import motion_options, read_set_up
from dic.commands.settings_file import settings_option, used_settings_file
from dic.commands.shared_options import COMMA_NEEDS, comma, csv, force, json_file, strain_options
from dic.errors import CorrelationError
from dic.pipeline import SurfaceSettings
from dic.settings import declared_in
from dic.shell.console import say
from dic.shell.output_paths import PATH, require_places
from dic.shell.progress import progress


@options
class AnewOptions:
    """Options for calibration and alignments; None means the value in RESULTS."""

    calibration_file: Path | None = option(
        "--calibration", help="Calibration file, for a series of images.", common=True
    )
    alignments: tuple[str, ...] = option(
        "--alignment",
        multiple=True,
        metavar="[CAMERA=]FILE",
        help="Alignment file from an earlier rotation on this fixture; for a run with the camera's name, and"
        " repeated for each camera.",
    )

    def of_series(self, assumed: Chosen[Motion], known: Motion) -> Motion:
        """Return the motion of a series; a value without an option comes from `known`."""
        kind = assumed.values["kind"]
        if kind is not None and kind != known.kind:
            # Only rigid motion has an alignment, and only rigid motion has no hinge.
            alignment = known.alignment if kind == "rigid" else None
            hinge = known.tilt_axis_mm if kind != "rigid" else None
            known = replace(known, kind=kind, alignment=alignment, tilt_axis_mm=hinge)
        given = {}
        if self.alignments:
            given["alignment"] = dic.out_of_plane.load_alignment(Path(self.alignments[-1]))
        return assumed.settings(known, **given)

    def of_run(
        self, assumed: Chosen[Motion], grid: Chosen[GridAccuracy], known: CorrectionSettings
    ) -> CorrectionSettings | None:
        """Return a run's settings of corrections; None without options, so that the old settings are used."""
        given = {**assumed.values, **grid.values}
        values = {name: value for name, value in given.items() if value is not None}
        values.pop("kind", None)
        if self.alignments:
            found = all_of(*(partial(read_alignment, text) for text in self.alignments))
            values["alignments"] = dict(found)
        return replace(known, **values) if values else None

    def require(self, source: str, *, series: bool) -> None:
        """Raise an error if an option of a run is given for a series, or an option of a series for a run."""
        idle = {"--plate-mm": "surface_plate_mm"}
        idle |= {f"--{name.replace('_', '-')}": f"grid_{name}" for name in declared_in(GridAccuracy)}
        if not series:
            idle = {"--calibration": "anew_calibration_file", "--motion": "assumed_kind"}
        for name, parameter in idle.items():
            # A settings file may have values for both series and runs, so check only options of the command
            # line.
            if click.get_current_context().get_parameter_source(parameter) is ParameterSource.COMMANDLINE:
                other, kind = ("a run", "a series of images") if series else ("a series of images", "a run")
                expected, remedy = f"the results of {other}", f"leave out {name}"
                raise CorrelationError(source, f"apply {name}", expected, f"those of {kind}", remedy)


@options
class StrainOutputOptions:
    """Options that name the output files of `dic strain`."""

    output: Path | None = option("-o", "--output", help="New result file, HDF5.", common=True)
    csv_folder: Path | None = csv()
    decimal_comma: bool = comma()
    json_file: Path | None = json_file()
    force: bool = force()


@dataclass(frozen=True)
class Given:
    """The groups of options of `dic strain`."""

    strain: Chosen[StrainSettings]
    anew: AnewOptions
    assumed: Chosen[Motion]
    surface: Chosen[SurfaceSettings]
    grid: Chosen[GridAccuracy]
    outputs: StrainOutputOptions


@click.command(cls=Grouped)
@click.argument("results", type=PATH)
@settings_option
@strain_options
@use("anew", AnewOptions, title="Motion")
@motion_options
@use("surface", SurfaceSettings, title="Motion")
@use("grid", GridAccuracy, title="Target")
@use("outputs", StrainOutputOptions, needs=COMMA_NEEDS)
@gather("given", Given)
def strain(results: Path, given: Given) -> None:
    """Compute strain again from the displacement fields in RESULTS, without images and without correlation.

    RESULTS is the result file of `dic correlate` or `dic process`. Settings without an option stay as they
    were in RESULTS: strain window, calibration, assumed motion. A complete new measurement with the same
    settings would give the same results.

    Exit status: 0 if all images are measured well, 1 if an image is measured poorly, 2 if an image could not
    be measured.
    """
    anew, series = given.anew, dic.pipeline.is_series_result(results)
    anew.require(str(results), series=series)
    alignments = [Path(text.rpartition("=")[2]) for text in anew.alignments]
    read = [results, anew.calibration_file, *alignments, used_settings_file()]
    if series:
        _of_series(results, given, read)
    else:
        _of_run(results, given, read)


as_in_results(strain, "strain", "anew", "assumed", "surface")


def _of_series(results: Path, given: Given, read: list[Path | None]) -> None:
    anew, outputs = given.anew, given.outputs
    result = dic.load_series_result(results)
    known = dic.pipeline.SeriesSetUp.of_job(dic.pipeline.job_of_fields(result), result.calibration)
    motion_before = known.motion or Motion()
    how, motion = all_of(
        partial(given.strain.settings, known.strain), partial(anew.of_series, given.assumed, motion_before)
    )
    set_up = replace(known, strain=how, motion=motion)
    if anew.calibration_file is not None:
        set_up = read_set_up(anew.calibration_file, how, motion)
    set_up.require_use(result.series.reference.shape)
    labels = [each.label for each in result.outcomes]
    files = dic.derived.SeriesFiles(
        outputs.output, outputs.csv_folder, None, [Path(label) for label in labels]
    )
    written = [outputs.json_file, *files.all()]
    require_places(read, written, force=outputs.force, new_folders=files.folders)
    files.make_folders()
    places = SeriesPlaces(files, dic.pictures.MapSettings(), outputs.decimal_comma)
    work = SeriesEvaluation(result.series.reference, labels, result.settings, set_up, places)
    with dic.pipeline.series_anew(result, set_up, outputs.output, read) as measuring:
        work.measure(measuring, "computing strain")
    if outputs.json_file is not None:
        work.write_json(outputs.json_file, result.reference_name, None)
    end(work.record)


def _of_run(results: Path, given: Given, read: list[Path | None]) -> None:
    outputs = given.outputs
    result = dic.load_run_result(results)
    known = dic.pipeline.strain_of_job(dic.pipeline.job_of_fields(result))
    how, correcting = all_of(
        partial(given.strain.settings, known),
        partial(given.anew.of_run, given.assumed, given.grid, result.correcting),
    )
    places = RunOutputOptions(**vars(outputs), report_file=None, gauges_file=None, fields_from=None)
    places.require_places(read, outputs.output)
    images = sum(len(camera.measurements) for camera in result.cameras)
    with progress("computing strain", images) as bar:
        found = dic.strain_of_run(
            result,
            outputs.output,
            strain=how,
            correcting=correcting,
            plate_mm=given.surface.values["plate_mm"],
            on_image=bar.advance,
            inputs=[path for path in read if path is not None and path != results],
        )
    say(table(found))
    if outputs.output is not None:
        say(f"results: {outputs.output}")
    places.write(found)
    click.get_current_context().exit(problems(result.source, found))
