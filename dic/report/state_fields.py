"""Maps of the strain along the specimen at chosen points of the curve, all on one scale."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dic.errors import MeasurementError
from dic.pictures.background import Background, background_of
from dic.pictures.contact_sheet import shortened
from dic.pictures.frames import draw_axes, draw_bar, draw_title
from dic.pictures.layout import PanelLayout
from dic.pictures.maps import cut_ends
from dic.pictures.marks import MARGIN_MM, Text
from dic.pictures.page import Page
from dic.pictures.painting import Painter
from dic.pictures.panels import Maps, Scale, common_name, finished, in_readable_unit, maps_of, widened
from dic.pictures.settings import MapSettings
from dic.report.camera_images import ReportedImages
from dic.report.numbers import fixed
from dic.report.states import HALF, CurvePoint
from dic.report.style import pixels_uri

_ALONG_Y_DEG = 45.0
_WIDTHS_MM = {3: 190.0, 4: 230.0}
"""Width of the picture by the number of its columns. It is enlarged to the width of the page, so that its
text can be read."""
_WIDEST_MM = 300.0
_DPI = 150
_LONGEST_NAME = 8
_LEAST_COLUMNS = 3
"""Least number of columns of a picture, so that the maps of one or two points are not larger than those of
three.
"""


@dataclass(frozen=True)
class StatePicture:
    """The maps of one camera at the chosen points of the stress-strain curve."""

    camera: str
    kind: str
    """Name of the strain, such as "εyy corrected"; only "εyy" if the maps show different kinds of strain."""
    uri: str
    """The picture as a data URI; two rows, on the reference and on the deformed image."""
    missing: list[str]
    """One sentence for each point without a map, without its deformed image, or with another kind of strain
    than the other points.
    """


@dataclass(frozen=True)
class _Shown:
    state: CurvePoint
    reference: Maps
    deformed: Maps
    background: Background | None
    declined: str | None


def quantity_along(direction_deg: float) -> str:
    """Return the strain component nearest to a direction: "exx" or "eyy"."""
    away = abs((direction_deg + 90.0) % 180.0 - 90.0)
    return "exx" if away < _ALONG_Y_DEG else "eyy"


def state_picture(images: ReportedImages, states: Sequence[CurvePoint], quantity: str) -> StatePicture | None:
    """Return the maps of a camera at the chosen points; None if the camera measured none of these points.

    Only one image at a time is in memory. For each point, only the values of its map and a small picture are
    kept. There are at most `dic.report.states.MOST_STATES` points.
    """
    shown: list[_Shown] = []
    missing: list[str] = []
    scale: Scale = {}
    width_mm = _WIDTHS_MM.get(max(len(states), _LEAST_COLUMNS), _WIDEST_MM)
    on_reference = MapSettings(width_mm=width_mm, quantities=(quantity,), dpi=_DPI)
    on_deformed = replace(on_reference, on="deformed")
    for state in states:
        place = images.place(state.label)
        measured = None if place is None else images.series.images[place]
        if place is None or measured is None or measured.measurement is None:
            missing.append(f"{state.label} was not measured.")
            continue
        maps = maps_of(measured.measurement, on_reference, measured.correction)
        moved = maps_of(measured.measurement, on_deformed, measured.correction)
        deformed: Background | None = None
        try:
            deformed = background_of(images.deformed(place), moved.places)
        except MeasurementError as error:
            missing.append(f"The deformed image is not shown. {error}.")
        scale = widened(scale, maps)
        declined = None if measured.correction is None else measured.correction.declined
        shown.append(_Shown(state, maps, moved, deformed, declined))
    if not shown:
        return None
    name, mixed = common_name([one.reference.panels[0] for one in shown])
    if mixed:
        missing += [
            f"{one.state.label} was not corrected: {one.declined}; its map shows"
            f" {one.reference.panels[0].kind} strain."
            for one in shown
            if one.declined is not None
        ]
    # The points are the same in all images, so all maps have the same place on the reference image.
    background = background_of(images.series.reference, shown[0].reference.places)
    page = _draw(shown, background, on_reference, finished(scale, on_reference))
    return StatePicture(images.camera, name, pixels_uri(page.pixels(), all_colours=True), missing)


def _draw(shown: Sequence[_Shown], reference: Background, settings: MapSettings, scale: Scale) -> Page:
    """Return a page with a column for each point, on the reference and on the deformed image."""
    rows: list[list[tuple[Maps, Background | None]]] = [[(one.reference, reference) for one in shown]]
    under: list[Background | None] = [one.background for one in shown]
    if any(under):
        rows.append([(one.deformed, one.background) for one in shown])
    aspect = max(background.aspect for background in (reference, *under) if background is not None)
    unit, columns = shown[0].reference.places.unit, max(len(shown), _LEAST_COLUMNS)
    cells, width_mm, dpi = len(rows) * columns, settings.width_mm, settings.dpi
    layout = PanelLayout(cells, columns, width_mm, dpi, aspect, unit is not None, True, bars=False)
    page, painter = layout.new_page(), Painter(settings)
    panels, scale = in_readable_unit([one.reference.panels[0] for one in shown], scale)
    common, mixed = common_name(panels)
    for row, cells_of_row in enumerate(rows):
        for column, (maps, background) in enumerate(cells_of_row):
            index, kind = row * columns + column, f", {panels[column].kind}" if mixed else ""
            draw_title(page, layout, index, _title(shown[column].state, row, kind))
            place = layout.panel(index)
            if background is None:
                page.texts.append(Text(*place.middle, "no image", align="center"))
                continue
            place = place.fitted(background.aspect, dpi)
            if unit is not None:
                draw_axes(page, place, background.extent, unit, layout.is_outer(index))
            painter.begin(maps.places, background, [panels[column]], place)
            painter.draw(page, place, panels[column], scale)
    power = ""
    known = [panel for panel in panels if np.isfinite(panel.values).any()]
    if known:
        cut = cut_ends(known, scale)
        power = draw_bar(page, layout.bar(), scale[panels[0].quantity], cut, settings)
    page.add_title(f"{common}, {power}{panels[0].unit}", MARGIN_MM)
    return page


def _title(state: CurvePoint, row: int, kind: str) -> str:
    if row:
        return f"deformed: {shortened(state.label, beside=kind)}"
    name = state.words.replace(HALF, "half way")
    text = f"{fixed(state.stress_mpa, 0)} MPa, {fixed(100.0 * state.strain, 2)} %"
    return (f"{name}: {text}" if len(name) <= _LONGEST_NAME else text) + kind
