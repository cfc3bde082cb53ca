"""Draws the values of a map as colours over the image, at the pixels of a panel."""

from collections.abc import Callable, Sequence
from typing import Any, Generic, TypeVar

import numpy as np

from dic.pictures.background import Background
from dic.pictures.colours import colour_table
from dic.pictures.fields import Sampling
from dic.pictures.marks import Frame, Rect, Text
from dic.pictures.page import Page
from dic.pictures.panels import Panel, Scale
from dic.pictures.places import PointCells
from dic.pictures.settings import MapSettings

Item = TypeVar("Item")


class Latest(Generic[Item]):
    """The last result of a function, which is computed anew if its arguments have changed."""

    def __init__(self) -> None:
        self._known: tuple[tuple[Any, ...], Item] | None = None

    def of(self, arguments: tuple[Any, ...], compute: Callable[[], Item]) -> Item:
        """Return the last result if the arguments are equal to the last ones, otherwise the new result."""
        if self._known is not None:
            pairs = zip(self._known[0], arguments, strict=True)
            if all(one is other or np.array_equal(one, other) for one, other in pairs):
                return self._known[1]
        self._known = arguments, compute()
        return self._known[1]


class Painter:
    """Draws fields over an image; what is the same as in the picture before is not computed again."""

    def __init__(self, settings: MapSettings) -> None:
        self._settings = settings
        self._table = colour_table(settings.colours)
        self._pale, self._sampled = Latest[Frame](), Latest[Sampling | None]()
        self._grey: Frame | None = None
        self._sampling: Sampling | None = None

    def begin(self, cells: PointCells, background: Background, panels: Sequence[Panel], place: Rect) -> None:
        """Begin the panels of an image, which all have the size of `place`."""
        *_, width, height = place.px(self._settings.dpi)
        size = width, height
        self._grey = self._pale.of((background, size), lambda: background.shown(size))
        left, right, lower, upper = background.extent
        to_px = width / (right - left), height / (lower - upper)
        known = np.logical_or.reduce([np.isfinite(panel.values) for panel in panels])
        corners = (cells.drawn_corners() - (left, upper)) * to_px
        self._sampling = self._sampled.of((corners, known, size), lambda: Sampling.of(corners, known, size))

    def draw(self, page: Page, place: Rect, panel: Panel, scale: Scale) -> bool:
        """Draw the values of a map; return False if there is none."""
        assert self._grey is not None
        ends, sampling = scale.get(panel.quantity), self._sampling
        if ends is None or sampling is None or not np.isfinite(panel.values).any():
            page.pictures.append((place, self._grey))
            page.texts.append(Text(*place.middle, "no value", align="center", boxed=True))
            return False
        opacity = self._settings.opacity
        page.pictures.append((place, sampling.painted(panel.values, ends, self._table, opacity, self._grey)))
        return True
