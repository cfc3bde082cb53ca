"""A contact sheet: one quantity in all images of a series, side by side on one scale."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import PurePath

from dic.errors import CorrelationError
from dic.image.given import grey_image
from dic.out_of_plane.correction import Correction
from dic.pictures.background import background_of
from dic.pictures.frames import draw_bar, draw_title
from dic.pictures.layout import PanelLayout
from dic.pictures.maps import cut_ends
from dic.pictures.marks import FONT_PT, MARGIN_MM
from dic.pictures.page import Page
from dic.pictures.painting import Painter
from dic.pictures.panels import Maps, Panel, Scale, common_name, in_readable_unit, map_scale, maps_of
from dic.pictures.settings import MapSettings
from dic.strain.measurement import Measurement
from dic.typing import Grey, ImageLike, PathLike

MOST_PANELS = 48
"""Largest number of images shown; of a longer series, evenly spaced images from first to last are shown."""

_LONGEST_NAME, _SHORTEST_NAME = 24, 4


def shown_of(number: int) -> list[int]:
    """Return the indices of the images that a contact sheet of a series of `number` images shows."""
    return evenly_spaced(number, MOST_PANELS)


def evenly_spaced(number: int, most: int) -> list[int]:
    """Return at most `most` indices below `number`, evenly spaced, with the first and the last.

    `most` is at least 2.
    """
    if number <= most:
        return list(range(number))
    return sorted({round(k * (number - 1) / (most - 1)) for k in range(most)})


def write_contact_sheet(
    measurements: Sequence[Measurement],
    reference: ImageLike,
    path: PathLike,
    *,
    quantity: str = "eyy",
    corrections: Sequence[Correction | None] = (),
    settings: MapSettings | None = None,
) -> None:
    """Write one picture with a small map of one quantity for each image of a series, all on one scale.

    Parameters
    ----------
    measurements : sequence of Measurement
        At least one measurement. If there are more than 48 images, 48 of them are shown.
    reference : ndarray, shape (height, width), or path
        The reference image, which is drawn under all maps.
    path : path
        The file to write. The suffix of the file name determines the format, such as .png or .pdf.
    quantity : str
        "u", "v", "exx", "eyy" or "exy".
    corrections : sequence of Correction or None, optional
        Corrections of the measurements, in the same order. If a measurement has a correction, its map shows
        corrected values.
    settings : MapSettings, optional

    Raises
    ------
    MeasurementError
        If there is no measurement, or a setting is wrong.
    OSError
        If the file cannot be written.
    """
    settings = replace(settings or MapSettings(), quantities=(quantity,), on="reference")
    grey = grey_image(reference, "reference image")
    given = list(corrections) or [None] * len(measurements)
    scale = map_scale(measurements, settings, given)
    chosen = [(measurements[k], given[k]) for k in shown_of(len(measurements))]
    images = [(each.label, maps_of(each, settings, correction)) for each, correction in chosen]
    draw_contact_sheet(images, grey, len(measurements), settings, scale).write(path)


def draw_contact_sheet(
    images: Sequence[tuple[str, Maps]], reference: Grey, number: int, settings: MapSettings, scale: Scale
) -> Page:
    """Return a page with a map of each image, all on one scale.

    `images`: name of each image that is shown, and its map. `number`: number of all images of the series.
    `scale`: lower and upper end of the colour scale of each quantity.
    """
    if not images:
        raise CorrelationError("contact sheet", "draw", "at least one measured image", "none", "measure one")
    panels, scale = in_readable_unit([maps.panels[0] for _, maps in images], scale)
    background = background_of(reference, images[0][1].places)
    layout = PanelLayout.fitting(
        len(images), settings.width_mm, settings.dpi, background.aspect, ticks=False, title=True, bars=False
    )
    page = layout.new_page()
    common, mixed = common_name(panels)
    painter, known = Painter(settings), list[Panel]()
    for index, (name, maps) in enumerate(images):
        panel, place = panels[index], layout.panel(index)
        painter.begin(maps.places, background, [panel], place)
        if painter.draw(page, place, panel, scale):
            known.append(panel)
        kind = f", {panel.kind}" if mixed else ""
        text = shortened(name, beside=kind, most=layout.letters)
        draw_title(page, layout, index, text, FONT_PT - 1)
    power = ""
    if known:
        ends, cut = scale[panels[0].quantity], cut_ends(known, scale)
        power = draw_bar(page, layout.bar(), ends, cut, settings)
    share = "" if len(images) == number else f", {len(images)} of {number} images"
    page.add_title(f"{common}, {power}{panels[0].unit}{share}", MARGIN_MM)
    return page


def shortened(name: str, beside: str = "", most: int = _LONGEST_NAME) -> str:
    """Return the last part of a path, cut at its beginning if it is too long for a small map.

    The text `beside` follows the name and is not cut. Neither is a number before the name, as in "7: a.png".
    """
    number, colon, last = PurePath(name).name.rpartition(": ")
    most = min(most, _LONGEST_NAME) - len(beside) - len(number + colon)
    if most < _SHORTEST_NAME and colon:
        return number + beside
    return number + colon + (last if len(last) <= most else "…" + last[1 - max(most, 2) :]) + beside
