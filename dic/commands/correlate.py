"""The command `dic correlate`, which measures displacements and strains in image files."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dic.commands.correlation_options import StrainOptions, strain_options
from dic.commands.option_groups import all_of
from dic.commands.series_options import (
    CorrelationOptions,
    MotionOptions,
    OutputOptions,
    RegionOptions,
    StartOptions,
    correlation_options,
    motion_options,
    output_options,
    region_options,
    start_options,
)
from dic.errors import each_warning_once
from dic.files.writing import write_text
from dic.shell.output_paths import require_places

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from dic import (
        Alignment,
        Calibration,
        CorrelationSettings,
        MeasuredImage,
        Motion,
        StrainSettings,
    )
    from dic.commands.series_record import SeriesRecord
    from dic.pipeline.series_files import SeriesOutputs
    from dic.pipeline.series_maps import SeriesMaps

_FILE = click.Path(path_type=Path)
_UNCORRECTED = (
    "the ± of calibrated strain contains a possible motion out of the grid's plane; --motion corrects for it"
)


@click.command()
@click.argument("reference", type=_FILE)
@click.argument("deformed", type=_FILE, nargs=-1)
@click.option("--calibration", "calibration_file", type=_FILE, help="Calibration file, for results in mm.")
@correlation_options
@strain_options
@region_options
@start_options
@motion_options
@output_options
@each_warning_once()
def correlate(
    reference: Path,
    deformed: tuple[Path, ...],
    calibration_file: Path | None,
    correlation: CorrelationOptions,
    strain: StrainOptions,
    region: RegionOptions,
    start: StartOptions,
    motion: MotionOptions,
    outputs: OutputOptions,
) -> None:
    """Correlate DEFORMED images with the REFERENCE image.

    DEFORMED are image files, folders, quoted patterns such as "img*.tif", and TIFF files, whose pages are all
    measured. Names are taken in natural order: img2 before img10. Without DEFORMED, the first image of a
    folder, pattern or TIFF file is the reference of the others.

    If an image cannot be measured, the command reports the image and continues with the next. Ctrl-C ends
    the series after the current image and keeps its results. Exit status: 0 if all images are measured well,
    1 if an image is measured poorly, 2 if an image cannot be measured.
    """
    from dic import Series, SeriesImage, load_calibration, measure_series, read_image, write_region
    from dic.commands.series_record import SeriesRecord
    from dic.pipeline.series_files import SeriesOutputs
    from dic.pipeline.series_maps import SeriesMaps
    from dic.pipeline.series_sources import SeriesSources
    from dic.shell.console import fail, say

    settings, how, _, known, _, drawn = all_of(
        correlation.settings,
        strain.settings,
        start.check,
        motion.read,
        motion.require_rotation,
        lambda: outputs.maps.settings(calibrated=calibration_file is not None),
    )
    sources = SeriesSources.of(reference, deformed or None)
    files = outputs.files(sources.images)
    inputs = [*sources.files, calibration_file, *region.files(), motion.alignment_file]
    written = [outputs.json_file, motion.save_alignment, *region.outputs(), *files.all()]
    require_places(inputs, written, force=outputs.force)
    calibration = None if calibration_file is None else load_calibration(calibration_file)
    for note in sources.notes:
        say(note)
    image = read_image(sources.reference)
    hint = start.hint(image.shape)
    series = Series(image, region.read(image.shape), settings, incremental=start.incremental)
    images = [SeriesImage(path, str(path), hint) for path in sources.images]
    measured = measure_series(series, images, calibration, how, known)
    if series.specimen is not None and not series.specimen.is_whole:
        say(str(series.specimen))
    if region.write_mask is not None:
        write_region(series.region, image, region.write_mask)
    say(_gauge(how, settings, calibration))
    if calibration is not None and known.kind == "free":
        say(_UNCORRECTED)
    record = SeriesRecord(
        [image.label for image in images],
        calibrated=calibration is not None,
        keep_corrections=outputs.output is not None,
    )
    with SeriesMaps(image, files.pictures, drawn) as maps:
        with SeriesOutputs(settings, files, maps, decimal_comma=outputs.decimal_comma) as results:
            try:
                _measure(measured, record, results, sources.images, rotation=known.kind == "rigid")
                alignment = record.finish(calibration, known, results.rewrite)
            finally:
                results.write_table(record.rows)
            results.write_corrections(record.corrections)
        if outputs.json_file is not None:
            set_up = _set_up(calibration, known, alignment)
            if series.specimen is not None:
                set_up["specimen"] = series.specimen.as_dict()
            _write_json(outputs.json_file, sources.reference, record, settings, set_up)
        motion.save(alignment)
        # Pictures come last: they can be made again from what is written by now.
        _draw(maps)
    for sentence in record.bad:
        fail(sentence)
    click.get_current_context().exit(2 if record.failures else 1 if record.bad else 0)


def _measure(
    measured: "Iterable[MeasuredImage]",
    record: "SeriesRecord",
    results: "SeriesOutputs",
    files: "Sequence[Path]",
    *,
    rotation: bool,
) -> None:
    """Measure the images one by one, until the last or a signal; print and write each result at once."""
    from dic.shell.console import stopping_between
    from dic.shell.progress import progress

    with progress("correlating", len(files)) as bar, stopping_between() as stopped:
        for number, found in enumerate(measured, 1):
            if found.measurement is not None:
                results.write(number - 1, found.measurement, found.correction)
            record.add(found, rotation=rotation)
            bar.advance()
            if stopped() and number < len(files):
                left = f"{len(files) - number} of {len(files)} images not measured"
                rest = f"stopped by a signal, {left}"
                record.fail(str(files[number]), rest, "; those before it are kept")
                break


def _draw(maps: "SeriesMaps") -> None:
    """Draw the pictures that need the scale of the whole series, which is known now."""
    from dic.shell.progress import progress

    if maps.pictures_left:
        with progress("drawing", maps.pictures_left) as bar:
            maps.draw(bar.advance)


def _gauge(
    strain: "StrainSettings", settings: "CorrelationSettings", calibration: "Calibration | None"
) -> str:
    """Return the width of the virtual strain gauge and the period of strain that it resolves, as text."""
    from dic import gauge_text, strain_resolution_px

    gauge_px = strain.gauge_px(settings)
    gauge = gauge_text(gauge_px, None if calibration is None else gauge_px * calibration.mm_per_px)
    return f"{gauge}, which keeps 90 % of waves of strain of {strain_resolution_px(settings, strain):.0f} px"


def _write_json(
    path: Path,
    reference: Path,
    record: "SeriesRecord",
    settings: "CorrelationSettings",
    set_up: dict[str, Any],
) -> None:
    """Write the results of all images as JSON, for other programs."""
    content = {"reference": str(reference), "settings": vars(settings), "images": record.summaries}
    content |= set_up | {"failures": record.failures}
    write_text(path, json.dumps(content, indent=1))


def _set_up(
    calibration: "Calibration | None", motion: "Motion", alignment: "Alignment | None"
) -> dict[str, Any]:
    """Return the assumed motion, the rotation stage's alignment and the camera's sensitivity, for JSON."""
    from dic import Sensitivity

    if calibration is None:
        return {}
    sensitivity = Sensitivity.of(calibration)
    return {
        "motion": motion.kind,
        "shift": motion.shift.as_dict(),
        "alignment": None if alignment is None else alignment.as_dict(),
        "sensitivity": None if sensitivity is None else vars(sensitivity),
    }
