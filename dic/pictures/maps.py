"""Maps of displacement and strain, drawn over the reference or the deformed image."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dic.errors import MEASURE_FIRST, require_kind
from dic.files.writing import write_figure
from dic.image.given import grey_image
from dic.out_of_plane.correction import Correction
from dic.pictures.background import Background, background_of
from dic.pictures.layout import FONT_PT, MM_PER_IN, PanelLayout
from dic.pictures.panels import Maps, Panel, Scale, in_readable_unit, maps_of, scale_of
from dic.pictures.settings import COLOURS, MapSettings
from dic.strain.measurement import Measurement
from dic.typing import Float, ImageLike, PathLike

_GREY_PERCENTILES = (1.0, 99.5)
_MOST_BAR_NUMBERS, _BAR_NUMBER_MM = 8, 3.5
_LETTER_WIDTH, _LEAST_TITLE_PT = 0.6, 4.0
"""Mean width of a letter as a share of its size, and the least size of a title's letters."""


def write_maps(
    measurement: Measurement,
    image: ImageLike,
    path: PathLike,
    *,
    title: str | None = None,
    correction: Correction | None = None,
    settings: MapSettings | None = None,
    scale: Scale | None = None,
) -> None:
    """Write one picture with the maps of a measurement: two displacements and three strains.

    Parameters
    ----------
    measurement : Measurement
    image : ndarray, shape (height, width), or path
        The image under the maps: the reference image, or the deformed image if `settings.on` says so.
    path : path
        The file to write. The suffix of the file name determines the format, such as .png, .pdf or .svg.
    title : str, optional
        Title of the picture. Default: the measurement's label.
    correction : Correction, optional
        Correction of the measurement. If the image was corrected, the maps show corrected values instead of
        calibrated values.
    settings : MapSettings, optional
    scale : mapping, optional
        Lower and upper end of the colour scale of each quantity, for example from `dic.pictures.map_scale`.
        Default: the 1st to the 99th percentile of this image.

    Raises
    ------
    MeasurementError
        If an argument has the wrong type, or the settings ask for axes in mm without a calibration.
    OSError
        If the file cannot be written.
    """
    require_kind("measurement", measurement, Measurement, MEASURE_FIRST)
    settings = settings or MapSettings()
    grey = grey_image(image, "image under the maps")
    maps = maps_of(measurement, settings, correction)
    scale = scale_of([maps], settings) if scale is None else scale
    title = measurement.label if title is None else title
    write_figure(draw_maps(maps, grey, title, settings, scale), path, dpi=settings.dpi)


def draw_maps(maps: Maps, image: NDArray[Any], title: str, settings: MapSettings, scale: Scale) -> Any:
    """Return a matplotlib figure with all maps of one image, laid out by the shape of the specimen."""
    background = background_of(image, maps.places)
    panels, scale = in_readable_unit(maps.panels, scale)
    unit = maps.places.unit
    layout = PanelLayout.fitting(
        len(panels), settings.width_mm, background.aspect, ticks=unit is not None, title=bool(title)
    )
    figure = layout.new_figure()
    if title:
        size = fitting_pt(title, settings.width_mm, FONT_PT + 2)
        figure.suptitle(title, fontsize=size, y=1 - 1.0 / layout.height_mm, va="top")
    corners = maps.places.drawn_corners()
    for index, panel in enumerate(panels):
        axis = layout.add_axes(figure, index)
        draw_background(axis, background)
        if unit is not None:
            draw_numbers(axis, unit, layout, index)
        # If the height of the title is given, matplotlib need not measure all labels to find it.
        size = fitting_pt(panel.title, layout.title_mm, FONT_PT)
        axis.set_title(panel.title, fontsize=size, pad=2.5, y=1.0, loc="left")
        mesh = draw_panel(axis, panel, corners, settings, scale)
        if mesh is not None:
            draw_bar(figure, mesh, layout.add_bar(figure, index), cut_ends([panel], scale))
    return figure


def fitting_pt(title: str, width_mm: float, most_pt: float) -> float:
    """Return the size of a title's letters: `most_pt`, or less if the title would not fit into the width."""
    fitting = width_mm / MM_PER_IN * 72.0 / (_LETTER_WIDTH * max(len(title), 1))
    return min(most_pt, max(fitting, _LEAST_TITLE_PT))


def draw_background(axis: Any, background: Background) -> None:
    """Draw the image under a map, without numbers at the axes."""
    grey = background.grey
    low, high = np.nanpercentile(grey, _GREY_PERCENTILES)
    axis.imshow(grey, cmap="gray", vmin=low, vmax=high, extent=background.extent, aspect="auto")
    left, right, lower, upper = background.extent
    axis.set_xlim(left, right)
    axis.set_ylim(lower, upper)
    axis.grid(visible=False)  # a style with a grid would draw its lines over the map
    axis.set_axis_off()


def draw_numbers(axis: Any, unit: str, layout: PanelLayout, index: int) -> None:
    """Draw the numbers at the axes of a panel, at its sides that no other panel adjoins."""
    axis.set_axis_on()
    below, beside = layout.is_outer(index)
    axis.tick_params(labelsize=FONT_PT - 1, length=2, pad=1.5, labelbottom=below, labelleft=beside)
    across, up = layout.most_numbers
    axis.locator_params(axis="x", nbins=across)
    axis.locator_params(axis="y", nbins=up)
    x, y = ("X", "Y") if unit == "mm" else ("x", "y")
    if below:
        axis.set_xlabel(f"{x}, {unit}", fontsize=FONT_PT, labelpad=1)
    if beside:
        axis.set_ylabel(f"{y}, {unit}", fontsize=FONT_PT, labelpad=1)


def draw_panel(axis: Any, panel: Panel, corners: Float, settings: MapSettings, scale: Scale) -> Any:
    """Draw the values of a map as coloured cells; return the cells, or None if there is no value."""
    ends = scale.get(panel.quantity)
    if ends is None or not np.isfinite(panel.values).any():
        box = {"facecolor": "white", "edgecolor": "none", "pad": 1.5}
        axis.text(0.5, 0.5, "no value", transform=axis.transAxes, ha="center", fontsize=FONT_PT, bbox=box)
        return None
    return axis.pcolormesh(
        corners[..., 0], corners[..., 1], np.ma.masked_invalid(panel.values), shading="flat",
        cmap=COLOURS[settings.colours], alpha=settings.opacity, vmin=ends[0], vmax=ends[1], rasterized=True,
        linewidth=0, edgecolors="none",
    )  # fmt: skip


def draw_bar(figure: Any, mesh: Any, axis: Any, extend: str) -> None:
    """Draw the colour bar; an end of the bar is an arrow if the map has values beyond this end."""
    from matplotlib.ticker import MaxNLocator

    bar = figure.colorbar(mesh, cax=axis, extend=extend, extendfrac=0.04)
    height_mm = axis.get_position().height * figure.get_figheight() * MM_PER_IN
    most = max(1, min(_MOST_BAR_NUMBERS, int(height_mm / _BAR_NUMBER_MM)))
    bar.locator = MaxNLocator(nbins=most, steps=[1, 2, 5, 10])
    bar.update_ticks()
    bar.ax.tick_params(labelsize=FONT_PT - 1, length=2, pad=1.5)
    bar.ax.ticklabel_format(useOffset=False)


def cut_ends(panels: list[Panel], scale: Scale) -> str:
    """Return at which ends values exceed the scale: "neither", "min", "max" or "both"."""
    low, high = scale[panels[0].quantity]
    least = min(panel.ends[0] for panel in panels)
    most = max(panel.ends[1] for panel in panels)
    return {(False, False): "neither", (True, False): "min", (False, True): "max", (True, True): "both"}[
        least < low, most > high
    ]
