"""The layout of a page of maps, in millimetres: every picture has the width that the user asks for."""

from dataclasses import dataclass

from dic.pictures.marks import MARGIN_MM, Rect
from dic.pictures.page import Page

TITLE_MM = 5.5
_PANEL_TITLE_MM = 4.2
_BAR_MM, _BAR_NUMBERS_MM = 2.0, 4.0
_TICKS_LEFT_MM, _TICKS_BELOW_MM = 11.0, 8.5
_ACROSS_MM, _DOWN_MM = 3.0, 2.0
"""Space between panels."""
_LEAST_AXES_MM, _LEAST_SHARE = 20.0, 0.6
"""Least width of a panel with a colour bar, mm, and least share of the width of a row that panels take. A
picture whose panels would be narrower may be higher.
"""
_LETTER_MM = 1.25
"""Width of a letter of 6 pt."""
_NEARLY = 0.9
"""Of layouts whose panels have at least this share of the largest width, the lowest is chosen."""
_HEIGHTS = (0.9, 1.4)
"""Largest heights of a picture as shares of its width: first the usual one, then that of narrow specimens."""
_COMMON_BAR_MM = 90.0


@dataclass(frozen=True)
class PanelLayout:
    """The places of panels of equal size, and of their colour bars: one above each panel, or one for all."""

    number: int
    columns: int
    """Number of panels, and of panels in a row."""
    width_mm: float
    """Width of the picture."""
    dpi: float
    """Its resolution."""
    aspect: float
    """Height of a panel's axes over their width."""
    ticks: bool
    """True if the axes have numbers."""
    title: bool
    """True if the picture has a title."""
    bars: bool = True
    """True if each panel has its own colour bar; False for a single colour bar above all panels."""
    highest: float = _HEIGHTS[-1]
    """Largest height as a share of the width."""

    @classmethod
    def fitting(
        cls,
        number: int,
        width_mm: float,
        dpi: float,
        aspect: float,
        *,
        ticks: bool,
        title: bool,
        bars: bool = True,
    ) -> "PanelLayout":
        """Return the layout with the largest panels in a picture that is wider than high.

        A high and narrow specimen gets many columns, and a wide one few. If its maps would still be narrow,
        the picture may be as high as a page of paper.
        """
        for highest in _HEIGHTS:
            each = [
                cls(number, columns, width_mm, dpi, aspect, ticks, title, bars, highest)
                for columns in range(1, number + 1)
            ]
            widest = max(one.axes_mm[0] for one in each)
            large = (one for one in each if one.axes_mm[0] >= _NEARLY * widest)
            best = min(large, key=lambda one: one.height_mm)
            taken = best.columns * best.axes_mm[0] / width_mm
            if taken >= _LEAST_SHARE and (not bars or best.axes_mm[0] >= _LEAST_AXES_MM):
                break
        return best

    def new_page(self) -> Page:
        """Return an empty page of the picture's size."""
        return Page(self.width_mm, self.height_mm, self.dpi)

    def is_outer(self, index: int) -> tuple[bool, bool]:
        """Return whether a panel has numbers below it and at its left, because no other panel is there."""
        return index + self.columns >= self.number, index % self.columns == 0

    @property
    def _left_mm(self) -> float:
        """Left end of the first panel, such that all parts together are in the middle of the picture."""
        ticks = _TICKS_LEFT_MM if self.ticks else 0.0
        drawn = ticks + self.columns * (self.axes_mm[0] + _ACROSS_MM) - _ACROSS_MM
        return max(MARGIN_MM, (self.width_mm - drawn) / 2) + ticks

    @property
    def axes_mm(self) -> tuple[float, float]:
        """Width and height of a panel's axes."""
        room = self.width_mm - 2 * MARGIN_MM - (_TICKS_LEFT_MM if self.ticks else 0.0) + _ACROSS_MM
        width = room / self.columns - _ACROSS_MM
        height = (self.highest * self.width_mm - self._frame_mm) / self.rows - self._head_mm - _DOWN_MM
        width = min(max(width, 3.0), max(height, 3.0) / self.aspect)
        return width, width * self.aspect

    @property
    def cell_mm(self) -> float:
        """Width for the title of a panel."""
        return self.axes_mm[0] + _ACROSS_MM / 2

    @property
    def letters(self) -> int:
        """Number of letters of a panel's title that fit above it."""
        return max(1, int(self.cell_mm / _LETTER_MM))

    @property
    def _head_mm(self) -> float:
        """Height of the title of a panel and of its colour bar."""
        return _PANEL_TITLE_MM + (_BAR_MM + _BAR_NUMBERS_MM if self.bars else 0.0)

    @property
    def _top_mm(self) -> float:
        """Height of everything above the rows."""
        bar = 0.0 if self.bars else _BAR_MM + _BAR_NUMBERS_MM
        return MARGIN_MM + (TITLE_MM if self.title else 0.0) + bar

    @property
    def _frame_mm(self) -> float:
        """Height of all parts of the picture except the rows."""
        return self._top_mm + MARGIN_MM + (_TICKS_BELOW_MM if self.ticks else 0.0)

    @property
    def rows(self) -> int:
        """Number of rows of panels."""
        return -(-self.number // self.columns)

    @property
    def height_mm(self) -> float:
        """Height of the picture."""
        return self._frame_mm + self.rows * (self._head_mm + self.axes_mm[1] + _DOWN_MM)

    def panel(self, index: int) -> Rect:
        """Return the place of a panel's axes."""
        row, column = divmod(index, self.columns)
        width, height = self.axes_mm
        left = self._left_mm + column * (width + _ACROSS_MM)
        top = self._top_mm + row * (self._head_mm + height + _DOWN_MM) + self._head_mm
        return Rect(left, top, width, height).on_pixels(self.dpi)

    def bar(self, index: int = 0) -> Rect:
        """Return the place of the colour bar of a panel, or of the common one if `bars` is False."""
        panel = self.panel(index)
        if self.bars:
            top = panel.top - _BAR_NUMBERS_MM - _BAR_MM
            return Rect(panel.left, top, panel.width, _BAR_MM).on_pixels(self.dpi)
        width = min(_COMMON_BAR_MM, 0.8 * self.width_mm)
        top = self._top_mm - _BAR_NUMBERS_MM - _BAR_MM
        return Rect((self.width_mm - width) / 2, top, width, _BAR_MM).on_pixels(self.dpi)

    def title_top(self, index: int) -> float:
        """Return the upper end of a panel's title, mm from the top of the page."""
        return self.panel(index).top - self._head_mm
