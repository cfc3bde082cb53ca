"""The command `dic correlate`, which measures displacements and strains in image files."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import click
from numpy.typing import NDArray

import dic
from dic import CorrelationSettings, Motion, ReferenceSettings, StrainSettings
from dic.commands.map_options import MapOutputs, map_options, map_outputs
from dic.commands.options import Chosen, Grouped, all_of, gather
from dic.commands.series_evaluation import SeriesEvaluation, SeriesPlaces, end
from dic.commands.series_options import (
    AlignmentOptions,
    RegionOptions,
    SeriesOutputOptions,
    StartOptions,
    alignment_options,
    motion_options,
    output_options,
    read_set_up,
    region_options,
    start_options,
)
from dic.commands.settings_file import settings_option, used_settings_file
from dic.commands.shared_options import correlation_options, reference_options, strain_options
from dic.commands.worker_options import chosen_workers, worker_options
from dic.errors import each_warning_once
from dic.pictures import MapSettings
from dic.shell.console import say
from dic.shell.output_paths import PATH


@dataclass(frozen=True)
class Given:
    """The groups of options of `dic correlate`."""

    correlation: Chosen[CorrelationSettings]
    references: Chosen[ReferenceSettings]
    strain: Chosen[StrainSettings]
    region: RegionOptions
    start: StartOptions
    assumed: Chosen[Motion]
    alignment: AlignmentOptions
    outputs: SeriesOutputOptions
    maps: MapOutputs
    drawn: Chosen[MapSettings]

    def settings(self) -> tuple[Any, ...]:
        """Return settings, strain, motion, maps and gauges; raise an error that names all mistakes."""
        calibrated = self.start.calibration_file is not None
        correlation, strain, motion, maps, gauges, *_ = all_of(
            self.correlation.settings,
            self.strain.settings,
            lambda: self.alignment.read(self.assumed),
            lambda: self.maps.settings(self.drawn, calibrated=calibrated),
            self.outputs.gauges,
            self.references.settings,
            self.start.motion,
            self.start.require_static,
            lambda: self.alignment.require_rotation(self.assumed.values["kind"]),
        )
        return correlation, strain, motion, maps, gauges


@click.command(cls=Grouped)
@click.argument("reference", type=PATH)
@click.argument("deformed", type=PATH, nargs=-1)
@start_options
@region_options
@correlation_options
@reference_options
@strain_options
@motion_options
@alignment_options
@output_options
@map_outputs
@map_options
@settings_option
@worker_options
@gather("given", Given)
@each_warning_once()
def correlate(reference: Path, deformed: tuple[Path, ...], given: Given) -> None:
    """Correlate DEFORMED images with the REFERENCE image.

    DEFORMED are image files, folders, quoted patterns such as "img*.tif", and TIFF files and videos, whose
    pages and frames are all measured. Files are sorted in natural order: img2 before img10. Without DEFORMED,
    the first image of a folder, pattern, TIFF file or video is the reference of the other images.

    If an image cannot be measured, the command reports the image and continues with the next. Ctrl-C ends
    the series after the current image and keeps its results. Exit status: 0 if all images are measured well,
    1 if an image is measured poorly, 2 if an image cannot be measured.
    """
    settings, how, known, drawn, gauges = given.settings()
    region, outputs, calibration_file = given.region, given.outputs, given.start.calibration_file
    sources = dic.pipeline.SeriesSources.of(reference, deformed or None)
    static = given.start.still_images()
    files = outputs.files(sources.images, gauges, given.maps)
    known_files = [
        *static,
        calibration_file,
        *region.files(),
        given.alignment.alignment_file,
        outputs.gauges_file,
    ]
    known_files.append(used_settings_file())
    written = [outputs.json_file, given.alignment.save_alignment, *region.outputs(), *files.all()]
    outputs.require_places([*sources.files, *known_files], written, files.folders)
    set_up = read_set_up(calibration_file, how, known)
    for note in sources.notes:
        say(note)
    with chosen_workers(settings) as workers:
        image = dic.read_image(sources.reference, stored=True)
        of_files = _camera(image, sources, given, settings, workers)
        series = of_files.series
        set_up.require_use(series.shape)
        if series.specimen is not None and not series.specimen.is_whole:
            say(str(series.specimen))
        if static and set_up.motion is not None:
            still = dic.pipeline.static_errors(series, static, set_up.calibration, times=of_files.times)
            set_up = replace(set_up, motion=replace(set_up.motion, still=still))
        places = SeriesPlaces(files, drawn, outputs.decimal_comma)
        work = SeriesEvaluation(image, [str(path) for path in sources.images], settings, set_up, places)
        place, inputs = outputs.place(written), [outputs.fields_from, *known_files]
        whole = True
        with of_files.begun(image, set_up, place, inputs) as begun:
            if begun.earlier.note:
                say(begun.earlier.note)
            files.make_folders()
            if region.write_mask is not None:
                dic.specimen.write_region(series.region, image, region.write_mask)
            if isinstance(begun.earlier.same, dic.pipeline.SeriesResult):
                work.show(begun.earlier.same.series)
            elif begun.measuring is not None:
                whole = work.measure(begun.measuring)
        if outputs.json_file is not None:
            work.write_json(outputs.json_file, str(sources.reference), series.specimen)
        given.alignment.save(work.alignment)
        # Write the pictures last: if this fails, they can be drawn again from the files written before.
        work.draw()
        if not whole and outputs.output is not None:
            say("give the same command again to go on with the images that are not measured", err=True)
    end(work.record)


def _camera(
    image: NDArray[Any],
    sources: dic.pipeline.SeriesSources,
    given: Given,
    settings: CorrelationSettings,
    workers: dic.workers.Workers | None,
) -> dic.pipeline.SeriesCamera:
    """Return the camera of the series with its reference `image`."""
    digests = dic.pipeline.FileDigests()
    digest = digests.of(sources.reference)
    source = dic.pipeline.SeriesImage(sources.reference, str(sources.reference), digest=digest)
    known_image = dic.pipeline.KnownImage(source, image)
    rule = given.references.settings().incremental
    series = dic.correlation.Series(known_image, given.region.read(image.shape), settings, incremental=rule)
    return dic.pipeline.SeriesCamera(series, sources, rule, given.start.hint(image.shape), workers, digests)
