"""The pictures of the report on a series: maps of an image, the curve of the means, and a contact sheet."""

from dataclasses import replace

import numpy as np

from dic.gauges.plot import draw_gauges
from dic.gauges.series import GaugeSeries
from dic.pictures.contact_sheet import draw_contact_sheet, shown_of
from dic.pictures.maps import MapDrawer
from dic.pictures.panels import Maps, maps_of, scale_of
from dic.pictures.plots import draw_banded, plot_style as gauge_style
from dic.pictures.settings import MapSettings, PlotSettings
from dic.pipeline.measured_images import MeasuredSeries
from dic.report.series_means import SeriesMeans
from dic.report.strains import COMPONENTS
from dic.report.style import (
    MARKERS,
    OFF_AXIS_COLOURS,
    PICTURE_WIDTH_MM,
    legend_below,
    new_figure,
    pixels_uri,
    svg_uri,
)

STRAINS, DISPLACEMENTS = ("exx", "eyy", "exy"), ("u", "v")
_MAPS = MapSettings(width_mm=PICTURE_WIDTH_MM)
_MOST_MARKERS = 60
"""Curves with more points have no markers, which would cover one another."""
_PLOT = PlotSettings(width_mm=PICTURE_WIDTH_MM, height_mm=80.0)


def maps_picture(series: MeasuredSeries, index: int, quantities: tuple[str, ...]) -> str:
    """Return maps of some quantities of a measured image as a data URI; two maps are as large as three."""
    width_mm = PICTURE_WIDTH_MM * min(1.0, len(quantities) / len(STRAINS))
    settings = replace(_MAPS, quantities=quantities, width_mm=width_mm)
    maps = _maps(series, index, settings)
    page = MapDrawer(settings).draw(maps, series.reference, "", scale_of([maps], settings))
    return pixels_uri(page.pixels())


def sheet_picture(series: MeasuredSeries, means: SeriesMeans, quantity: str) -> str:
    """Return small maps of one quantity in all measured images, or in 48 of them, as a data URI."""
    settings = replace(_MAPS, quantities=(quantity,))
    shown = [means.measured[k] for k in shown_of(len(means.measured))]
    images = [(f"{k + 1}: {means.name(k)}", _maps(series, k, settings)) for k in shown]
    scale = scale_of([maps for _, maps in images], settings)
    page = draw_contact_sheet(images, series.reference, len(means.measured), settings, scale)
    return pixels_uri(page.pixels())


def mean_picture(means: SeriesMeans) -> str:
    """Return the mean strain of all images as a data URI: the best kind with 95 % bands, others as lines."""
    figure, (axis,) = new_figure(1, 3.4)
    numbers = np.arange(1.0, len(means.rows) + 1)
    best = means.best
    for order, name in enumerate(COMPONENTS):
        colour = OFF_AXIS_COLOURS[order]
        for kind in means.kinds[1:-1] if best == means.kinds[-1] else ():
            line = {"color": colour, "linestyle": (0, (3, 2)), "linewidth": 0.9, "alpha": 0.8}
            axis.plot(numbers, means.factor * means.values[kind][:, order], label=f"{name} {kind}", **line)
        style = {"color": colour, "marker": MARKERS[order] if len(numbers) <= _MOST_MARKERS else ""}
        values, stds = (means.factor * each[best][:, order] for each in (means.values, means.stds))
        draw_banded(axis, numbers, values, stds, f"{name} {best}", style)
    axis.set(xlabel="number of the image", ylabel=f"mean strain, {means.unit}")
    axis.xaxis.get_major_locator().set_params(integer=True)
    legend_below(figure, columns=3)
    return svg_uri(figure)


def gauges_picture(gauges: GaugeSeries) -> str:
    """Return the engineering strain of all gauges in all images as a data URI, with 95 % bands."""
    with gauge_style():
        return svg_uri(draw_gauges(gauges, _PLOT))


def _maps(series: MeasuredSeries, index: int, settings: MapSettings) -> Maps:
    image = series.images[index]
    assert image.measurement is not None
    return maps_of(image.measurement, settings, image.correction)
