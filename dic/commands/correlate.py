"""The command `dic correlate`, which measures displacements and strains in image files."""

import json
from contextlib import ExitStack
from functools import partial
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
from dic.files.lazy import Computed
from dic.files.writing import write_text
from dic.shell.output_paths import require_places

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from dic import (
        Alignment,
        Calibration,
        CorrelationSettings,
        MeasuredImage,
        Motion,
        Series,
        StrainSettings,
    )
    from dic.commands.series_record import SeriesRecord
    from dic.pipeline.series_files import SeriesOutputs
    from dic.pipeline.series_maps import SeriesMaps
    from dic.results.unfinished import FinishedImages, Unfinished

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
    from dic.commands.gauge_text import gauge_lines, gauges_dict
    from dic.commands.series_record import SeriesRecord
    from dic.pipeline.correlated import series_job
    from dic.pipeline.series_files import SeriesOutputs
    from dic.pipeline.series_maps import SeriesMaps
    from dic.pipeline.series_sources import SeriesSources
    from dic.shell.console import fail, say

    settings, how, _, known, _, drawn, gauges = all_of(
        correlation.settings,
        strain.settings,
        start.check,
        motion.read,
        motion.require_rotation,
        lambda: outputs.maps.settings(calibrated=calibration_file is not None),
        outputs.gauges,
    )
    sources = SeriesSources.of(reference, deformed or None)
    files = outputs.files(sources.images, gauges)
    known_files = [calibration_file, *region.files(), motion.alignment_file, outputs.gauges_file]
    written = [outputs.json_file, motion.save_alignment, *region.outputs(), *files.all()]
    _require_places([*sources.files, *known_files], written, outputs)
    calibration = None if calibration_file is None else load_calibration(calibration_file)
    for note in sources.notes:
        say(note)
    image = read_image(sources.reference)
    hint = start.hint(image.shape)
    series = Series(image, region.read(image.shape), settings, incremental=start.incremental)
    if series.specimen is not None and not series.specimen.is_whole:
        say(str(series.specimen))
    with ExitStack() as stack:
        kept: Unfinished | None = None
        digest: Callable[[Path], str] = _undigested
        if outputs.output is not None or known.kind == "rigid":
            job = partial(series_job, series, incremental=start.incremental)
            kept, digest = _kept(stack, job, sources.reference, outputs.output, written)
        finished = None if kept is None else kept.series(0)
        images = (SeriesImage(path, str(path), hint, digest(path)) for path in sources.images)
        measured_images = measure_series(series, images, calibration, how, known, finished)
        if region.write_mask is not None:
            write_region(series.region, image, region.write_mask)
        say(_gauge(how, settings, calibration))
        if calibration is not None and known.kind == "free":
            say(_UNCORRECTED)
        record = SeriesRecord([str(path) for path in sources.images], calibrated=calibration is not None)
        maps, alignment = SeriesMaps(image, files.pictures, drawn), known.alignment
        origin, comma = [sources.files[0], *known_files], outputs.decimal_comma
        with SeriesOutputs(settings, files, maps, origin, decimal_comma=comma) as results:
            results.read_gauges(calibration, image.shape)
            try:
                write = results.write if known.kind != "rigid" else lambda *_: None
                whole = _measure(measured_images, record, write, sources.images)
                if calibration is not None and finished is not None and known.kind == "rigid":
                    again = partial(_again, finished, series, calibration, how)
                    alignment = _correct(record, results, again, calibration, known)
                results.write_set_up(image, calibration, record.failures)
            finally:
                results.write_table(list(record.rows))
        for line in gauge_lines(results.gauge_series) if gauges else ():
            say(line)
        if outputs.json_file is not None:
            set_up = _set_up(series, calibration, known, alignment)
            set_up |= gauges_dict(results.gauge_series) if gauges else {}
            _write_json(outputs.json_file, sources.reference, record, settings, set_up)
        motion.save(alignment)
        # Pictures come last: they can be made again from what is written by now.
        _draw(maps)
        if kept is not None:
            kept.stays = not whole
    for sentence in record.bad:
        fail(sentence)
    click.get_current_context().exit(2 if record.failures else 1 if record.bad else 0)


def _require_places(
    inputs: "Sequence[Path | None]", written: "Sequence[Path | None]", outputs: OutputOptions
) -> None:
    """Raise an error if an output file cannot be written; an unfinished result may be gone on with."""
    from dic.results.unfinished import outputs_of

    earlier = [] if outputs.output is None else outputs_of(outputs.output)
    require_places(inputs, written, force=outputs.force, replaceable=earlier)


def _kept(
    stack: ExitStack,
    job: "Callable[[str], dict[str, Any]]",
    reference: Path,
    output: Path | None,
    written: "Sequence[Path | None]",
) -> "tuple[Unfinished, Callable[[Path], str]]":
    """Open the folder of the images that are finished, until `stack` ends.

    Return the folder and the function that gives the digest of an image file.
    """
    from dic.pipeline.correlated import FileDigests
    from dic.results.unfinished import result_place, unfinished

    digests = FileDigests()
    place = stack.enter_context(result_place(output))
    others = [path for path in written if path is not None]
    kept = stack.enter_context(unfinished(place, job(digests.of(reference)), others))
    return kept, digests.of


def _undigested(_: Path) -> str:
    """Return no digest: nothing is kept, so no image is looked for among those that are finished."""
    return ""


def _measure(
    images: "Iterable[MeasuredImage]",
    record: "SeriesRecord",
    write: "Callable[[int, MeasuredImage], None]",
    files: "Sequence[Path]",
) -> bool:
    """Measure the images one by one; print and write each result at once.

    Return True after the last image, and False if a signal stopped the series.
    """
    from dic.shell.console import stopping_between
    from dic.shell.progress import progress

    with progress("correlating", len(files)) as bar, stopping_between() as stopped:
        for number, found in enumerate(images):
            write(number, found)
            record.add(number, found)
            bar.advance()
            left = len(files) - number - 1
            if stopped() and left:
                rest = f"stopped by a signal, {left} of {len(files)} images not measured"
                record.fail(number + 1, str(files[number + 1]), rest, "; those before it are kept")
                return False
    return True


def _again(
    finished: "FinishedImages",
    series: "Series",
    calibration: "Calibration",
    strain: "StrainSettings",
    number: int,
) -> "MeasuredImage":
    """Return an image of a rotation that was correlated, without its correction."""
    from dic.pipeline.images import measured

    return measured(finished.read(number + 1, series.shared), calibration, strain)


def _correct(
    record: "SeriesRecord",
    results: "SeriesOutputs",
    again: "Callable[[int], MeasuredImage]",
    calibration: "Calibration",
    motion: "Motion",
) -> "Alignment | None":
    """Correct, print and write all images of a rotation together, and return the stage's alignment."""
    from dic import corrected_rotation

    if not record.measured:
        return motion.alignment
    images = Computed(len(record.measured), lambda place: again(record.measured[place]))
    corrected, alignment = corrected_rotation(images, calibration, motion)
    for number, image in zip(record.measured, corrected, strict=True):
        results.write(number, image)
        record.correct(number, image)
    return alignment


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
    content = {"reference": str(reference), "settings": vars(settings), "images": record.summaries()}
    content |= set_up | {"failures": record.failures}
    write_text(path, json.dumps(content, indent=1))


def _set_up(
    series: "Series", calibration: "Calibration | None", motion: "Motion", alignment: "Alignment | None"
) -> dict[str, Any]:
    """Return specimen, assumed motion, the stage's alignment and the camera's sensitivity, for JSON."""
    from dic import Sensitivity

    specimen = {} if series.specimen is None else {"specimen": series.specimen.as_dict()}
    if calibration is None:
        return specimen
    sensitivity = Sensitivity.of(calibration)
    return specimen | {
        "motion": motion.kind,
        "shift": motion.shift.as_dict(),
        "alignment": None if alignment is None else alignment.as_dict(),
        "sensitivity": None if sensitivity is None else vars(sensitivity),
    }
