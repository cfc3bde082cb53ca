"""Draws the gauges and their measured points on the reference image, so that a person can check them."""

import numpy as np

from dic.gauges.placed import PlacedGauges
from dic.pictures.background import Background
from dic.pictures.frames import draw_axes
from dic.pictures.ink import fitting_pt
from dic.pictures.marks import CAPITAL_MM, FONT_PT, Dots, Line, Rect, Text
from dic.pictures.page import Page
from dic.pictures.places import mapped
from dic.strain.measurement import Measurement
from dic.typing import Float, Grey

_COLOURS = (
    (230, 159, 0), (86, 180, 233), (0, 158, 115), (240, 228, 66), (0, 114, 178), (213, 94, 0),
    (204, 121, 167),
)  # fmt: skip
"""Colours of gauges, chosen by Okabe and Ito so that colour-blind people can distinguish them."""
_DPI = 130
_WIDTH_MM, _HIGHEST_MM = 229.0, 400.0
_MARGIN_MM, _LEFT_MM, _TOP_MM, _TICKS_MM = 2.0, 14.0, 8.0, 10.0
_NAMES, _NAME_MM = 3, 4.5
"""Number of names side by side, and height of each."""
_MOST_POINTS = 4000
_FEW_LINES = 5
"""If a gauge has more lines than this number, its lines are drawn thin."""
_LINE_PT, _DOT_PT, _CROSS_MM = 1.8, 1.5, 2.0


def draw_gauges(placed: PlacedGauges, measurement: Measurement, reference: Grey) -> Page:
    """Return a page with the reference image, the gauges, their names and their points.

    `measurement`: the measurement of any image of the series.
    """
    height, width = reference.shape
    side_mm = min(_WIDTH_MM - _LEFT_MM - _MARGIN_MM, _HIGHEST_MM * width / height)
    place = Rect(_LEFT_MM, _TOP_MM, side_mm, side_mm * height / width).on_pixels(_DPI)
    below_mm = place.top + place.height + _TICKS_MM
    rows = -(-len(placed.gauges) // _NAMES)
    page = Page(_WIDTH_MM, below_mm + rows * _NAME_MM + _MARGIN_MM, _DPI)
    page.add_title("gauges and their points in the reference image", _MARGIN_MM)
    extent = (-0.5, width - 0.5, height - 0.5, -0.5)
    *_, width_px, height_px = place.px(_DPI)
    page.pictures.append((place, Background(reference, extent).shown((width_px, height_px))))
    draw_axes(page, place, extent, "px")
    homography = _to_px(measurement) if any(gauge.unit == "mm" for gauge in placed.gauges) else np.eye(3)
    to_mm = place.width / width
    shown = zip(placed.gauges, placed.points_of(measurement), strict=True)
    for number, (gauge, points) in enumerate(shown):
        colour = _COLOURS[number % len(_COLOURS)]
        kept = points[:: 1 + len(points) // _MOST_POINTS]
        page.marks.append(Dots((kept + 0.5) * to_mm + (place.left, place.top), _DOT_PT, colour))
        lines = [_in_px(line, gauge.unit, homography) for line in gauge.drawn_lines()]
        _draw(page, [(line + 0.5) * to_mm + (place.left, place.top) for line in lines], colour)
        # The names stand below the picture: beside gauges they would overlap, because gauges often overlap.
        row, column = divmod(number, _NAMES)
        room_mm = (_WIDTH_MM - _LEFT_MM) / _NAMES
        left, middle = _LEFT_MM + column * room_mm, below_mm + row * _NAME_MM
        page.marks.append(Line(np.array([(left, middle), (left + 6.0, middle)]), _LINE_PT + 1.0, colour))
        name = f"{gauge.name} ({gauge.kind})"
        size = fitting_pt(name, room_mm - 10.0, FONT_PT)
        page.texts.append(Text(left + 7.5, middle + CAPITAL_MM * size / 2, name, size))
    return page


def _draw(page: Page, lines: list[Float], colour: tuple[int, int, int]) -> None:
    """Draw the lines of one gauge, in mm on the page."""
    thin = len(lines) > _FEW_LINES
    for line in lines:
        if len(line) == 1:
            arm = np.array([(_CROSS_MM, 0.0), (0.0, _CROSS_MM)])
            strokes = [np.concatenate([line - reach, line + reach]) for reach in arm]
        else:
            strokes = [line]
        for stroke in strokes:
            if not thin:
                page.marks.append(Line(stroke, _LINE_PT + 1.2, (0, 0, 0)))
            page.marks.append(Line(stroke, 0.7 if thin else _LINE_PT, colour))


def _in_px(line: Float, unit: str, homography: Float) -> Float:
    return line * (1.0, -1.0) if unit == "px" else mapped(homography, line)


def _to_px(measurement: Measurement) -> Float:
    """Return the homography from millimetres to image pixels that fits the measured points."""
    import cv2

    if measurement.calibrated is None:
        raise ValueError("places in millimetres need calibrated displacements")
    use = measurement.field.active
    points = measurement.field.points.reshape(*use.shape, 2)[use]
    found, _ = cv2.findHomography(measurement.calibrated.position[use], points)
    return np.asarray(found, np.float64)
