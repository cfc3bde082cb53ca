"""What stands around a map: its frame with numbers, its title and its colour bar."""

import numpy as np

from dic.pictures.colours import blended, colour_table
from dic.pictures.ink import fitting_pt
from dic.pictures.layout import PanelLayout
from dic.pictures.marks import CAPITAL_MM, FONT_PT, Line, Rect, Text
from dic.pictures.page import Page
from dic.pictures.settings import MapSettings
from dic.pictures.ticks import fitting_ticks

_SMALL_PT = FONT_PT - 1
_TICK_MM = 0.7
_TIP = 1.2
"""Length of the arrow at the end of a colour bar, in heights of the bar."""
UNDER = 0.8
"""Grey level under a colour bar, about the mean of an image under its map."""


def draw_title(page: Page, layout: PanelLayout, index: int, title: str, size_pt: float = FONT_PT) -> None:
    """Draw the title above a panel and its colour bar."""
    size = fitting_pt(title, layout.cell_mm, size_pt)
    left, baseline = layout.panel(index).left, layout.title_top(index) + CAPITAL_MM * FONT_PT + 0.8
    page.texts.append(Text(left, baseline, title, size))


def draw_axes(
    page: Page,
    place: Rect,
    extent: tuple[float, float, float, float],
    unit: str,
    outer: tuple[bool, bool] = (True, True),
) -> None:
    """Draw the frame of a panel, with numbers below it and at its left if these sides are `outer`."""
    page.marks.append(Line(place.outline()))
    left, right, lower, upper = extent
    below, beside = outer
    x, y = ("X", "Y") if unit == "mm" else ("x", "y")
    bottom, half = place.top + place.height, CAPITAL_MM * _SMALL_PT / 2
    across = fitting_ticks(left, right, place.width, _SMALL_PT)
    for value, text in zip(across.values, across.texts, strict=True):
        at = place.left + (value - left) / (right - left) * place.width
        page.marks.append(Line(np.array([(at, bottom), (at, bottom + _TICK_MM)])))
        if below:
            page.texts.append(Text(at, bottom + _TICK_MM + 0.6 + 2 * half, text, _SMALL_PT, "center"))
    up = fitting_ticks(lower, upper, place.height, _SMALL_PT, beside=True)
    for value, text in zip(up.values, up.texts, strict=True):
        at = place.top + (value - upper) / (lower - upper) * place.height
        page.marks.append(Line(np.array([(place.left - _TICK_MM, at), (place.left, at)])))
        if beside:
            page.texts.append(Text(place.left - _TICK_MM - 0.5, at + half, text, _SMALL_PT, "right"))
    if below:
        middle = place.left + place.width / 2
        page.texts.append(Text(middle, bottom + 6.3, f"{x}, {across.power}{unit}", FONT_PT, "center"))
    if beside:
        middle = place.top + place.height / 2
        page.texts.append(
            Text(place.left - 8.6, middle, f"{y}, {up.power}{unit}", FONT_PT, "center", upright=True)
        )


def draw_bar(page: Page, place: Rect, ends: tuple[float, float], extend: str, settings: MapSettings) -> str:
    """Draw a colour bar with numbers below it, and return the power of ten of the numbers, for their unit.

    An end of the bar is an arrow if the map has values beyond this end.
    """
    *_, width, height = place.px(page.dpi)
    table = blended(colour_table(settings.colours), settings.opacity, UNDER)
    tip = round(_TIP * height)
    inner = width - 2 * tip
    along = np.arange(width)
    levels = np.rint(((along - tip + 0.5) / max(inner, 1)).clip(0.0, 1.0) * 255.0).astype(int)
    # The share of each pixel inside the bar, whose ends narrow to a point.
    aside = np.abs(np.arange(height)[:, None] + 0.5 - height / 2)
    beyond = np.maximum(tip - along - 0.5, along + 0.5 - (width - tip)).clip(0.0)
    inside = (height / 2 * (1.0 - beyond / tip) - aside + 0.5).clip(0.0, 1.0)
    low, high = extend in ("min", "both"), extend in ("max", "both")
    inside[:, :tip] *= low
    inside[:, width - tip :] *= high
    colours = inside[..., None] * table[levels] + 255.0 * (1.0 - inside[..., None])
    page.pictures.append((place, np.rint(colours).astype(np.uint8)))
    mm = place.width / width
    first, last = place.left + tip * mm, place.left + (width - tip) * mm
    top, bottom, middle = place.top, place.top + place.height, place.top + place.height / 2
    left_end = [(place.left, middle)] if low else []
    right_end = [(place.left + place.width, middle)] if high else []
    corners = [
        (first, top),
        (last, top),
        *right_end,
        (last, bottom),
        (first, bottom),
        *left_end,
        (first, top),
    ]
    page.marks.append(Line(np.array(corners)))
    ticks = fitting_ticks(*ends, last - first, _SMALL_PT)
    for value, text in zip(ticks.values, ticks.texts, strict=True):
        at = first + (value - ends[0]) / (ends[1] - ends[0]) * (last - first)
        page.marks.append(Line(np.array([(at, bottom), (at, bottom + _TICK_MM)])))
        baseline = bottom + _TICK_MM + 0.5 + CAPITAL_MM * _SMALL_PT
        page.texts.append(Text(at, baseline, text, _SMALL_PT, "center"))
    return ticks.power
