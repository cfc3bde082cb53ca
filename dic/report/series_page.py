"""The HTML page of the report on series of images that `dic correlate` measured."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePath

from dic.calibration.calibration import Calibration
from dic.errors import RunFileError, require_kind
from dic.files.shortened import some_sentences
from dic.files.writing import write_text
from dic.gauges.series import GaugeSeries
from dic.keywords import takes_settings
from dic.pipeline.result import SeriesResult
from dic.report.pdf import require_pdf, write_pdf
from dic.report.series import LONG
from dic.report.series_means import ImageRow, SeriesMeans, means_of
from dic.report.series_pictures import (
    DISPLACEMENTS,
    STRAINS,
    gauges_picture,
    maps_picture,
    mean_picture,
    sheet_picture,
)
from dic.report.strains import COMPONENTS
from dic.report.style import plot_style
from dic.report.tables import correlation_rows
from dic.report.templating import page_templates
from dic.report.tensile_page import tensile_view
from dic.report.tensile_record import TensileTest
from dic.strain.measurement import Measurement
from dic.strain.strain import gauge_text
from dic.typing import PathLike

_LOAD_FIRST = "read them first: dic.load_series_result(path)"
_UNFINISHED = "The series was stopped before its last image; the same command goes on with the others."


@dataclass(frozen=True)
class SeriesView:
    """The content of the report on one series, in the form that the page template needs.

    An attribute for a picture contains a data URI, or an empty text if the series has no such picture.
    """

    name: str
    title: str
    summary: list[str]
    shown: str
    component: str
    strains: str
    displacements: str
    curve: str
    gauges: str
    sheet: str
    unit: str
    kinds: tuple[str, ...]
    rows: list[ImageRow]
    left_out: str
    settings: list[tuple[str, str]]
    inputs: list[tuple[str, str]]


@takes_settings()
def write_series_report(
    results: SeriesResult | Sequence[SeriesResult],
    path: PathLike,
    *,
    tests: Sequence[TensileTest] = (),
    gauges: GaugeSeries | None = None,
    image: str = "",
    title: str = "",
    pdf: PathLike | None = None,
) -> None:
    """Write the report of one or several series as one HTML file with all figures inside.

    An existing file is replaced only after the new report is complete.

    Parameters
    ----------
    results : SeriesResult, or sequence of SeriesResult
    path : path
    tests : sequence of TensileTest, optional
        Tensile tests in these series, from `tensile_test`.
    gauges : GaugeSeries, optional
        Gauges in the first series, whose strain is drawn instead of the mean strain.
    image : str, optional
        Name of the image whose maps are at the top. Default: the last image that was measured.
    title : str, optional
        Default: what was measured, and the first and the last image.
    pdf : path, optional
        The same page as a PDF file. This needs the extra ``offaxis[pdf]``.

    Raises
    ------
    OSError
        If a file cannot be written.
    OutputError
        If `pdf` is given and WeasyPrint is not installed.
    RunFileError
        If `image` is not exactly one measured image.
    """
    results = [results] if isinstance(results, SeriesResult) else results
    require_kind("results", results, Sequence, _LOAD_FIRST)
    for result in results:
        require_kind("results", result, SeriesResult, _LOAD_FIRST)
    if pdf is not None:
        require_pdf(pdf)
    with plot_style():
        tensile = [tensile_view(test, results) for test in tests]
        own = [gauges, *[None] * (len(results) - 1)]
        views = [
            _view(result, image, each, tested=bool(tests)) for result, each in zip(results, own, strict=True)
        ]
    title = title or _title(results, views)
    template = page_templates().get_template("series.html.j2")
    page: str = template.render(title=title, views=views, tensile=tensile)
    write_text(path, page)
    if pdf is not None:
        write_pdf(page, pdf)


def series_dict(result: SeriesResult) -> dict[str, object]:
    """Return the results of a series for JSON; `docs/results.md` explains the keys of `images`."""
    return {
        "results": result.source,
        "reference": result.reference_name,
        "unfinished": not result.finished,
        "images": [image.row() for image in result.series.images],
        "command": result.provenance.command,
        "versions": result.provenance.versions,
        "inputs": dict(result.provenance.inputs),
    }


def _title(results: Sequence[SeriesResult], views: Sequence[SeriesView]) -> str:
    return views[0].title if len(results) == 1 else f"Strain in {len(results)} series of images"


def _title_of(means: SeriesMeans) -> str:
    total = len(means.rows)
    names = [PurePath(means.name(k)).stem for k in means.measured] or [means.name(0)]
    if len(names) == 1:
        return f"Strain in {names[0]}"
    count = f"{len(names)} images" if len(names) == total else f"{len(names)} of {total} images"
    return f"Strain in {count}, {names[0]} to {names[-1]}"


def _view(result: SeriesResult, wanted: str, gauges: GaugeSeries | None, *, tested: bool) -> SeriesView:
    series = result.series
    means = means_of(series.images, calibrated=result.calibration is not None)
    settings = [("Command", result.provenance.command), ("Versions", result.provenance.versions)]
    strains = displacements = curve = sheet = shown = component = ""
    summary, at = [_count(result, means)], 0
    if not result.finished:
        summary.append(_UNFINISHED)
    if means.measured:
        at = _chosen(result.source, means, wanted)
        shown = means.name(at)
        summary.append(_mean(means, at))
        strains, displacements = (maps_picture(series, at, what) for what in (STRAINS, DISPLACEMENTS))
        largest = _largest(means, at)
        component = COMPONENTS[largest]
        if len(means.rows) > 1:
            sheet = sheet_picture(series, means, STRAINS[largest])
            curve = "" if tested or gauges is not None else mean_picture(means)
        measurement = series.images[means.measured[0]].measurement
        if measurement is not None:
            settings += _settings(measurement, result.calibration)
    rows = means.table(at)
    return SeriesView(
        name=Path(result.source).name,
        title=_title_of(means),
        summary=summary,
        shown=shown,
        component=component,
        strains=strains,
        displacements=displacements,
        curve=curve,
        gauges="" if gauges is None else gauges_picture(gauges),
        sheet=sheet,
        unit=means.unit,
        kinds=means.kinds,
        rows=rows,
        left_out=_left_out(rows, means),
        settings=settings,
        inputs=list(result.provenance.inputs.items()),
    )


def _chosen(source: str, means: SeriesMeans, wanted: str) -> int:
    if not wanted:
        return means.measured[-1]
    found = [k for k in means.find(wanted) if k in means.measured]
    if len(found) != 1:
        got = f"{len(found)} of the name {wanted!r}"
        if not found and means.find(wanted):
            got = f"{wanted!r}, which could not be measured"
        remedy = f"give --image {means.name(means.measured[-1])}"
        raise RunFileError(source, "choose an image", "one measured image", got, remedy)
    return found[0]


def _left_out(rows: Sequence[ImageRow], means: SeriesMeans) -> str:
    """Return a sentence about the images without a row in the table; empty if all have one."""
    if len(rows) == len(means.rows):
        return ""
    return f"{len(rows)} of {len(means.rows)} images; `dic strain RESULTS --csv FOLDER` writes all of them."


def _largest(means: SeriesMeans, index: int) -> int:
    """Return the index of the component with the largest mean strain in an image."""
    sizes = [-1.0 if value != value else abs(value) for value in means.values[means.kind_at(index)][index]]
    return sizes.index(max(sizes))


def _count(result: SeriesResult, means: SeriesMeans) -> str:
    measured, total = len(means.measured), len(means.rows)
    against = f", compared with {PurePath(result.reference_name).name}" if result.reference_name else ""
    found = "all were measured" if measured == total else f"{total - measured} could not be measured"
    if total > LONG and measured < total:
        failed = [
            f"{means.name(k)}: {row['error']}" for k, row in enumerate(means.rows) if "converged" not in row
        ]
        found += f" ({'; '.join(some_sentences(failed, 'the JSON file has', 5))})"
    return f"{total} image{'s' if total > 1 else ''}{against}; {found}."


def _mean(means: SeriesMeans, index: int) -> str:
    """Return the mean strain of an image as a sentence."""
    kind = means.kind_at(index)
    texts = zip(COMPONENTS, means.texts(index, kind), strict=True)
    values = ", ".join(f"{name} = {text} {means.unit}".replace(" ", "\u00a0") for name, text in texts)
    return f"Mean {kind} strain of {means.name(index)}: {values}."


def _settings(measurement: Measurement, calibration: Calibration | None) -> list[tuple[str, str]]:
    strain = measurement.strain_settings
    axes_mm_per_px = None if calibration is None else calibration.axes_mm_per_px
    return [
        *correlation_rows(measurement.settings),
        (
            "Strain",
            f"{strain.measure}, local strain from {strain.source}, {strain.window_points} points wide",
        ),
        ("Gauge", gauge_text(measurement.gauge_px, axes_mm_per_px)),
    ]
