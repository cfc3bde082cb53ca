"""The HTML page of the report on series of images that `dic correlate` measured."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from dic.calibration.calibration import Calibration
from dic.files.writing import write_text
from dic.pictures.maps import draw_maps
from dic.pictures.panels import maps_of, scale_of
from dic.pictures.settings import MapSettings
from dic.pipeline.series_result import MeasuredImage
from dic.pipeline.series_result_file import SeriesResult
from dic.report.numbers import micro, micro_with_std
from dic.report.pdf import require_pdf, write_pdf
from dic.report.style import PICTURE_COLUMNS, PICTURE_DPI, PICTURE_WIDTH_MM, plot_style, png_uri
from dic.report.templating import page_templates
from dic.report.tensile_page import tensile_view
from dic.report.tensile_test import TensileTest
from dic.strain.measurement import Measurement
from dic.strain.strain import gauge_text
from dic.typing import PathLike

_MAPS = MapSettings(width_mm=PICTURE_WIDTH_MM)
_COMPONENTS = ("exx", "eyy", "exy")


@dataclass(frozen=True)
class ImageRow:
    """A row of the table: image, share of points that were measured in %, strains in µε, and a problem."""

    name: str
    share: str
    strains: list[str]
    problem: str


@dataclass(frozen=True)
class SeriesView:
    """The content of the report on one series, in the form that the page template needs."""

    name: str
    kinds: list[str]
    rows: list[ImageRow]
    settings: list[tuple[str, str]]
    inputs: list[tuple[str, str]]
    pictures: list[tuple[str, str]]


def write_series_report(
    results: Sequence[SeriesResult],
    path: PathLike,
    *,
    tests: Sequence[TensileTest] = (),
    pdf: PathLike | None = None,
) -> None:
    """Write the report of one or several series as one HTML file with all figures inside.

    An existing file is replaced only after the new report is complete. `tests` are tensile tests in these
    series, from `tensile_test`, whose material properties are shown first. `pdf` is the same page
    as a PDF file.

    Raises
    ------
    OSError
        If a file cannot be written.
    OutputError
        If `pdf` is given and WeasyPrint is not installed.
    """
    if pdf is not None:
        require_pdf(pdf)
    with plot_style():
        tensile = [tensile_view(test, results) for test in tests]
        views = [_view(result) for result in results]
    page: str = page_templates().get_template("series.html.j2").render(views=views, tensile=tensile)
    write_text(path, page)
    if pdf is not None:
        write_pdf(page, pdf)


def _view(result: SeriesResult) -> SeriesView:
    kinds = ["raw"] if result.calibration is None else ["raw", "calibrated", "corrected"]
    rows, settings = [], [("Command", result.provenance.command), ("Versions", result.provenance.versions)]
    measured = []
    for place, image in enumerate(result.series.images):
        rows.append(_row(image, kinds))
        if image.measurement is not None:
            measured.append(place)
            if len(measured) == 1:
                settings += _settings(image.measurement, result.calibration)
    return SeriesView(
        Path(result.source).name,
        kinds,
        rows,
        settings,
        list(result.provenance.inputs.items()),
        _pictures(result, measured),
    )


def _row(image: MeasuredImage, kinds: Sequence[str]) -> ImageRow:
    row, name = image.row(), Path(image.label).name
    if image.measurement is None:
        return ImageRow(name, "–", ["–"] * 3 * len(kinds), str(image.failure))
    points = row["points"] + row["out_of_view"]
    share = 100 * row["converged"] // points if points else 0
    strains = []
    for kind in kinds:
        mean = row.get(kind, {})
        known = kind != "corrected" or mean.get("applied", False)
        # If there is a calibration, leave out the standard deviations of raw strain: they lack the part that
        # motion out of the grid's plane causes.
        stated = kind != "raw" or len(kinds) == 1
        strains += [_strain(mean, name, stated=stated) if known else "–" for name in _COMPONENTS]
    reason = row.get("corrected", {}).get("reason")
    return ImageRow(name, str(share), strains, row["error"] or (f"not corrected: {reason}" if reason else ""))


def _strain(mean: dict[str, float | None], component: str, *, stated: bool) -> str:
    value, std = mean[component], mean[f"{component}_std"] if stated else None
    if value is None:
        return "–"
    return micro(1e6 * value) if std is None else micro_with_std(1e6 * value, 1e6 * std)


def _settings(measurement: Measurement, calibration: Calibration | None) -> list[tuple[str, str]]:
    settings, strain = measurement.settings, measurement.strain_settings
    axes_mm_per_px = None if calibration is None else calibration.axes_mm_per_px
    return [
        ("Subset", f"{settings.subset_px} px, step {settings.step_px} px, {settings.shape} shape function"),
        ("Interpolation", f"B-spline of order {settings.order}"),
        ("Correlation", f"IC-GN on ZNSSD, at least {settings.min_zncc:g} ZNCC"),
        (
            "Strain",
            f"{strain.measure}, local strain from {strain.source}, {strain.window_points} points wide",
        ),
        ("Gauge", gauge_text(measurement.gauge_px, axes_mm_per_px)),
    ]


def _pictures(result: SeriesResult, measured: Sequence[int]) -> list[tuple[str, str]]:
    """Return the name and the maps, as a data URI, of the first, the middle and the last image."""
    chosen = sorted({measured[0], measured[len(measured) // 2], measured[-1]}) if measured else []
    pictures = []
    for place in chosen:
        image = result.series.images[place]
        if image.measurement is not None:
            maps = maps_of(image.measurement, _MAPS, image.correction)
            scale = scale_of([maps], _MAPS)
            figure = draw_maps(maps, result.series.reference, "", _MAPS, scale, columns=PICTURE_COLUMNS)
            pictures.append((Path(image.label).name, png_uri(figure, dpi=PICTURE_DPI)))
    return pictures
