"""Reads gauges in the images of a result file, or of a series that has just been measured."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from dic.calibration.calibration import Calibration
from dic.derived.kept_readings import KeptReadings
from dic.errors import GaugeError, RunFileError
from dic.files.reading import opened
from dic.gauges.channel import gauge_channels
from dic.gauges.declared import Gauge
from dic.gauges.picture import draw_gauges
from dic.gauges.placed import PlacedGauges
from dic.gauges.series import GaugeImage, GaugeSeries
from dic.pipeline.measured_images import CameraView, MeasuredImage, require_camera
from dic.pipeline.result import SeriesResult
from dic.pipeline.result_file import Loaded, Results, with_results
from dic.pipeline.series_image import of_page
from dic.results.job import ImageOutcome, content_of
from dic.results.readings import reading_names
from dic.typing import PathLike

_SIGNATURE = b"\x89HDF\r\n\x1a\n"


class GaugeReader:
    """Reads gauges in the images of one series, one by one.

    The points of the gauges are found in the first image that could be measured.

    Parameters
    ----------
    gauges : sequence of Gauge
    calibration : Calibration or None
        Needed for the errors of calibrated displacements, if the results were read from a file.
    image_shape : tuple of int
        Height and width of the images, px.
    """

    def __init__(
        self, gauges: Sequence[Gauge], calibration: Calibration | None, image_shape: tuple[int, ...]
    ) -> None:
        self._gauges, self._calibration, self._shape = gauges, calibration, image_shape
        self.placed: PlacedGauges | None = None

    def read(self, image: MeasuredImage, **known: Any) -> GaugeImage:
        """Return the readings in an image.

        Raises
        ------
        GaugeError
            If a gauge lies outside the measured points. The error is raised at the first image that could be
            measured.
        """
        known = image.time.as_dict() | known
        measurement = image.measurement
        if measurement is None:
            return GaugeImage(image.label, known=known, failure=image.failure)
        if self.placed is None:
            self.placed = PlacedGauges.of(self._gauges, measurement, self._calibration, self._shape)
        readings = self.placed.read(measurement, image.correction)
        return GaugeImage(image.label, readings, known, digest=measurement.digest)


def measure_gauges(
    results: Results,
    gauges: Sequence[Gauge],
    *,
    camera: str | None = None,
    kept: KeptReadings | None = None,
) -> GaugeSeries:
    """Read gauges in all images of a measurement, without correlating again.

    Parameters
    ----------
    results : path, MeasuredSeries, SeriesResult or RunResult
        A result file of `dic correlate` or `dic process`, or the result of `measure_images`, `process_run` or
        `load_run_result`.
    gauges : sequence of Gauge
        From `read_gauges`, or made in Python.
    camera : str, optional
        Camera of a run. Default: all cameras of the run, if all gauges are in millimetres.
    kept : KeptReadings, optional
        Readings of a command that was killed; only the images after them are read, and are added to them.

    Raises
    ------
    GaugeError
        If a gauge lies outside the image or outside the measured points, or if two gauges have the same name.
    RunFileError
        If the result file cannot be read.
    """
    found = with_results(results, partial(_read_all, gauges=tuple(gauges), camera=camera, kept=kept))
    return replace(found, source=str(results)) if isinstance(results, str | Path) else found


def _read_all(
    results: Loaded, gauges: Sequence[Gauge], camera: str | None, kept: KeptReadings | None
) -> GaugeSeries:
    known = [] if kept is None else list(kept.finished())
    for image in _images(results, gauges, camera, len(known)):
        if kept is not None:
            kept.add(image)
        known.append(image)
    images = tuple(known)
    source, run = getattr(results, "source", ""), getattr(results, "info", None)
    outcomes: Sequence[ImageOutcome] | None = getattr(results, "outcomes", None)
    in_order = outcomes is None or bool(outcomes)
    channels = gauge_channels(next((view.steps for view in results.views if view.steps), ()))
    found = GaugeSeries(source, tuple(gauges), images, in_order, run, channels=channels)
    if not isinstance(results, SeriesResult):
        return found
    reference = results.reference_name
    digest = results.provenance.inputs.get(reference, "")
    contents = _contents(images, results.outcomes)
    return replace(found, reference_digest=digest, contents=contents, reference=reference)


def write_gauge_picture(
    results: Results, gauges: Sequence[Gauge], path: PathLike, *, camera: str | None = None
) -> None:
    """Write a picture of the reference image with the gauges, their names, and the points that they use.

    Parameters
    ----------
    results, gauges, camera
        As for `measure_gauges`. If there are several cameras, the picture shows the first one.
    path : path
        The ending determines the format, such as .png or .pdf.

    Raises
    ------
    GaugeError
        As for `measure_gauges`, and if no image could be measured.
    OSError
        If the picture cannot be written.
    """
    with_results(results, partial(_draw, gauges=tuple(gauges), path=path, camera=camera))


def _draw(results: Loaded, gauges: Sequence[Gauge], path: PathLike, camera: str | None) -> None:
    view, reader = next(reader_of(results, gauges, camera))
    for image in view.series.images:
        if image.measurement is not None:
            reader.read(image)
            break
    if reader.placed is None or image.measurement is None:
        remedy = "measure at least one image"
        raise GaugeError("gauges", "draw", "an image that could be measured", "none", remedy)
    draw_gauges(reader.placed, image.measurement, view.series.reference).write(path)


def is_results(path: PathLike) -> bool:
    """Return True if a file begins with the signature of HDF5, so that it is not a table.

    Raises
    ------
    RunFileError
        If the file cannot be read.
    """
    try:
        with opened(path) as content:
            return content[: len(_SIGNATURE)] == _SIGNATURE
    except OSError as error:
        got, remedy = error.strerror or str(error), "name another file"
        raise RunFileError(str(path), "read", "a table or a result file", got, remedy) from error


def reader_of(
    results: Loaded, gauges: Sequence[Gauge], camera: str | None
) -> Iterator[tuple[CameraView, GaugeReader]]:
    """Yield the results of each camera, and a reader of the gauges in its images."""
    views = results.views
    if camera is not None and not views[0].camera:
        remedy = "leave the camera out"
        raise GaugeError("results", "choose a camera", "results of a run", "those of a series", remedy)
    if camera is None:
        _require_one_in_px(views, gauges)
    for view in require_camera(views, camera, getattr(results, "source", "")):
        yield view, GaugeReader(gauges, view.calibration, view.series.reference.shape)


def _images(results: Loaded, gauges: Sequence[Gauge], camera: str | None, first: int) -> Iterator[GaugeImage]:
    """Yield the readings of all images after the first ones; images of several cameras follow each other."""
    for view, reader in reader_of(results, gauges, camera):
        images, passed = view.series.images, min(first, len(view.series.images))
        first -= passed
        for k in range(passed, len(images)):
            known = view.known(k) if view.camera else {}
            names = ["camera", "step", *reading_names([known])]
            yield reader.read(images[k], **{name: known[name] for name in names if name in known})


def _contents(images: Sequence[GaugeImage], outcomes: Sequence[ImageOutcome]) -> tuple[str, ...]:
    """Return the content of each image of a result file; an empty tuple for files of earlier versions.

    The stored content depends on the expected motion of the specimen. So it is used only for an image that
    could not be measured, whose digest is not stored.
    """
    pairs = zip(images, outcomes, strict=True) if outcomes else ()
    return tuple(
        content_of(of_page(image.digest, Path(image.label))) if image.digest else outcome.content
        for image, outcome in pairs
    )


def _require_one_in_px(views: Sequence[CameraView], gauges: Sequence[Gauge]) -> None:
    """Raise an error if there are several cameras and a gauge in pixels, which belongs to one of them."""
    names, in_px = [view.camera for view in views], [gauge.name for gauge in gauges if gauge.unit == "px"]
    if len(names) > 1 and in_px:
        raise GaugeError(
            f"gauge {in_px[0]!r}",
            "choose a camera",
            f"one of {', '.join(names)}, because the gauge is in pixels",
            "none",
            f'give --camera {names[0]}, or declare the gauges in millimetres with unit = "mm"',
        )
