"""Draws the values of a map as colours over the image, at the pixels of a panel."""

from collections.abc import Sequence

import numpy as np

from dic.pictures.background import Background
from dic.pictures.colours import colour_table
from dic.pictures.fields import Sampling
from dic.pictures.page import Page, Rect, Text
from dic.pictures.panels import Panel, Scale
from dic.pictures.places import PointCells
from dic.pictures.settings import MapSettings


class Painter:
    """Draws fields of one image over the same picture, in panels of the same size."""

    def __init__(
        self,
        cells: PointCells,
        background: Background,
        panels: Sequence[Panel],
        place: Rect,
        settings: MapSettings,
    ) -> None:
        self._settings = settings
        *_, width, height = place.px(settings.dpi)
        self._size = width, height
        self._grey = background.shown(self._size)
        left, right, lower, upper = background.extent
        corners = (cells.drawn_corners() - (left, upper)) * (width / (right - left), height / (lower - upper))
        known = np.logical_or.reduce([np.isfinite(panel.values) for panel in panels])
        self._sampling = Sampling.of(corners, known, self._size)
        self._table = colour_table(settings.colours)

    def draw(self, page: Page, place: Rect, panel: Panel, scale: Scale) -> bool:
        """Draw the values of a map; return False if there is none."""
        picture, ends = self._grey, scale.get(panel.quantity)
        left, top, *_ = place.px(page.dpi)
        drawn = ends is not None and self._sampling is not None and np.isfinite(panel.values).any()
        if ends is not None and self._sampling is not None and drawn:
            picture = self._sampling.painted(
                panel.values, ends, self._table, self._settings.opacity, self._grey
            )
        else:
            middle = place.left + place.width / 2, place.top + place.height / 2
            page.texts.append(Text(*middle, "no value", align="center", boxed=True))
        page.pictures.append((place, picture))
        return bool(drawn)
