"""Exports results: each image is read, written in all formats, and then removed from memory."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from dic.errors import OutputError, RunFileError
from dic.exports.formats import EXPORTS, exporter_of
from dic.exports.image import (
    Exporter,
    ExportImage,
    ExportSeries,
    stem_of,
    unique_names,
)
from dic.exports.tables import CsvExporter
from dic.files.writing import reason
from dic.pipeline.measured_images import CameraView, MeasuredImage, require_camera
from dic.pipeline.result_file import Loaded, Results, with_results
from dic.results.points import PointValues
from dic.results.provenance import versions
from dic.results.readings import channel_units, known_readings
from dic.results.strain_table import STRAIN_FILE, write_strain_table
from dic.strain.measurement import Measurement
from dic.typing import PathLike


@dataclass(frozen=True)
class Export:
    """The files that an export has written.

    Attributes
    ----------
    folders : mapping of str to Path
        The folder of each format.
    images : list of str
        The images that were written.
    failures : list of str
        One sentence for each image that could not be measured and was therefore not written.
    """

    folders: Mapping[str, Path]
    images: list[str] = field(default_factory=list)
    failures: list[str] = field(default_factory=list)

    def as_dict(self) -> dict[str, Any]:
        """Return the export as a dict for JSON."""
        folders = {name: str(folder) for name, folder in self.folders.items()}
        return {"folders": folders, "images": self.images, "failures": self.failures}


@dataclass(frozen=True)
class ExportSource:
    """A series of images to export."""

    camera: str
    """Name of the camera of a run; "" for a series of images."""
    images: Sequence[MeasuredImage]
    names: list[str]
    """Name of each image's files, without suffix."""
    known: list[dict[str, Any]]
    """The known values of each step of a run, such as its load; empty for a series."""
    about: Mapping[str, str | float]
    channels: Mapping[str, str] = field(default_factory=dict)
    """The units of the values of channels."""

    def exported(
        self, failed: Callable[[MeasuredImage], None] = lambda image: None, *, raw_strain: bool = False
    ) -> Iterator[ExportImage]:
        """Yield the measured images, each read when it is needed; call `failed` for the others."""
        for k, image in enumerate(self.images):
            if image.measurement is None:
                failed(image)
                continue
            points = PointValues.of(image.measurement, image.correction, raw_strain=raw_strain)
            # The time of a file's last change is lost if the file is copied, and most formats name no source.
            taken = {} if image.time.source == "file" else image.time.as_dict()
            known = taken | (self.known[k] if k < len(self.known) else {})
            yield ExportImage(k + 1, self.names[k], points, known_readings(known), image.row() | known)

    def series(self, first: Measurement) -> ExportSeries:
        """Return the properties that all images share; the settings are those of the first measurement."""
        settings: dict[str, str | float] = {
            "subset_px": first.settings.subset_px,
            "step_px": first.settings.step_px,
            "strain_measure": first.strain_settings.measure,
            "strain_window_points": first.strain_settings.window_points,
            "strain_source": first.strain_settings.source,
            "strain_gauge_px": first.gauge_px,
            "strain_kind": "raw" if first.calibrated is None else "calibrated",
        }
        if first.gauge_mm is not None:
            settings["strain_gauge_mm"] = first.gauge_mm
        return ExportSeries(self.camera, {**self.about, **settings}, len(self.images), self.channels)


def export_results(
    results: Results,
    folder: PathLike,
    formats: Sequence[str] = ("csv",),
    *,
    camera: str | None = None,
    raw_strain: bool = False,
    decimal_comma: bool = False,
    replace: bool = False,
    on_image: Callable[[int], None] = lambda total: None,
) -> Export:
    """Write the fields of results in the formats of other programs. `docs/exports.md` describes the files.

    Memory does not depend on the number of images.

    Parameters
    ----------
    results : path, MeasuredSeries, SeriesResult or RunResult
        A result file of `dic correlate` or `dic process`, or the results that `dic` has read from such a
        file.
    folder : path
        Each format gets a folder of its own in this folder.
    formats : sequence of str
        Some of the names in `dic.exports.EXPORTS`, such as "csv" or "netcdf".
    camera : str, optional
        Camera of a run. Default: all cameras.
    raw_strain : bool
        True to write also the raw local strains `raw_exx` …, which are computed from the displacements in
        pixels.
    decimal_comma : bool
        True for tables (csv) with a decimal comma and semicolons between cells.
    replace : bool
        True if files of an earlier export may be replaced.
    on_image : callable, optional
        Called with the number of all images, after each image.

    Raises
    ------
    OutputError
        If a format is unknown, or the folder cannot be used.
    RunFileError
        If the results cannot be read, or a run has no such camera.
    """
    for name in formats:
        if name not in EXPORTS:
            expected, remedy = f"some of {', '.join(EXPORTS)}", "give for example csv"
            raise OutputError("settings", "format of the export", expected, str(name), remedy)
    if decimal_comma and "csv" not in formats:
        expected, remedy = "the format csv beside it", "give csv, or leave out --decimal-comma"
        raise OutputError("settings", "--decimal-comma", expected, ", ".join(formats), remedy)
    folders = {name: Path(folder) / name for name in dict.fromkeys(formats)}
    _require_free(folders, replace=replace)
    choice = _Choice(folders, camera, raw_strain=raw_strain, comma=decimal_comma)
    work = partial(_export, choice=choice, on_image=on_image)
    return with_results(results, work, local_strain=True)


def sources_of(results: Loaded, camera: str | None) -> list[ExportSource]:
    """Return the series of images in results: one series, or one for each camera of a run.

    Raises `RunFileError` if there is no such camera.
    """
    return [_source_of(results, view) for view in require_camera(results.views, camera, "results")]


def _source_of(results: Loaded, view: CameraView) -> ExportSource:
    images, origin = view.series.images, getattr(results, "provenance", None)
    about = {
        "source": results.result_file,
        "command": "" if origin is None else origin.command,
        "versions": versions() if origin is None else origin.versions,
    }
    if view.camera:
        names = [f"{view.camera}_{step.kind}_{step.index}" for step in view.steps]
        known = [view.known(k) for k in range(len(view.steps))]
        about |= {"camera": view.camera}
        return ExportSource(view.camera, images, names, known, about, channel_units(view.steps))
    outcomes = getattr(results, "outcomes", ())
    labels = [each.label for each in outcomes] or [image.label for image in images]
    names = unique_names([stem_of(label) for label in labels], [Path(STRAIN_FILE).stem])
    return ExportSource("", images, names, [], about)


@dataclass(frozen=True)
class _Choice:
    """The caller's choices: folders of the formats, camera, raw strain, and the form of tables."""

    folders: Mapping[str, Path]
    camera: str | None
    raw_strain: bool
    comma: bool


@dataclass
class _Work:
    """Writes the images of one camera in all chosen formats.

    All cameras share the rows of the table and the list of exported images. The exporters are created when
    the first image is known.
    """

    choice: _Choice
    export: Export
    rows: list[Mapping[str, Any]]
    exporters: list[Exporter] = field(default_factory=list)

    def add(self, image: ExportImage, source: ExportSource) -> None:
        if not self.exporters:
            series = source.series(image.points.measurement)
            self.exporters = [self._exporter(name, series) for name in self.choice.folders]
        self.rows.append(image.row)
        for exporter in self.exporters:
            exporter.add(image)
        self.export.images.append(image.points.label)

    def failed(self, image: MeasuredImage, camera: str) -> None:
        own = {"file": "", "camera": camera} if camera else {}
        self.rows.append(image.row() | own)
        self.export.failures.append(f"{image.label}: {image.failure}")

    def _exporter(self, name: str, series: ExportSeries) -> Exporter:
        folder = self.choice.folders[name]
        folder.mkdir(parents=True, exist_ok=True)
        if name == "csv":
            return CsvExporter(folder, series, decimal_comma=self.choice.comma)
        return exporter_of(name)(folder, series)


def _export(results: Loaded, choice: _Choice, on_image: Callable[[int], None]) -> Export:
    folders = choice.folders
    export, rows = Export(folders), list[Mapping[str, Any]]()
    sources = sources_of(results, choice.camera)
    total = sum(len(source.images) for source in sources)
    for source in sources:
        work = _Work(choice, export, rows)
        failed = partial(work.failed, camera=source.camera)
        try:
            with _as_output_error(folders):
                for image in source.exported(failed, raw_strain=choice.raw_strain):
                    work.add(image, source)
                    on_image(total)
                for exporter in work.exporters:
                    exporter.finish()
        except BaseException:
            for exporter in work.exporters:
                exporter.abandon()
            raise
    if not export.images:
        got = f"none ({export.failures[0]})" if export.failures else "none"
        expected, remedy = "at least one image that could be measured", "measure the images again"
        raise RunFileError("results", "export", expected, got, remedy)
    if "csv" in folders:
        with _as_output_error(folders):
            # One table has the images of all cameras, also of a camera whose images all failed.
            write_strain_table(rows, folders["csv"] / STRAIN_FILE, decimal_comma=choice.comma)
    return export


@contextmanager
def _as_output_error(folders: Mapping[str, Path]) -> Iterator[None]:
    """Report an error of the file system in one sentence; errors of reading a result file pass unchanged."""
    try:
        yield
    except OSError as error:
        place = str(error.filename or next(iter(folders.values())).parent)
        expected, remedy = "a folder with room for the export", "name another folder"
        raise OutputError(place, "write export", expected, reason(error), remedy) from error


def _require_free(folders: Mapping[str, Path], *, replace: bool) -> None:
    """Raise an error if a folder cannot be used, or contains files that may not be replaced."""
    with _as_output_error(folders):
        for folder in folders.values():
            for place in (folder.parent, folder):
                if place.exists() and not place.is_dir():
                    expected, remedy = "a folder", "name another folder"
                    raise OutputError(str(place), "write export", expected, "a file", remedy)
            if not replace and folder.is_dir() and any(folder.iterdir()):
                expected, got = "a folder that is empty or new", "one with files"
                remedy = "name another folder, or replace its files with --force"
                raise OutputError(str(folder), "write export", expected, got, remedy)
