"""The layout of a page of maps, in millimetres: every picture has the width that the user asks for."""

from dataclasses import dataclass, replace
from typing import Any

MM_PER_IN = 25.4
FONT_PT = 7.0
_TITLE_MM = 5.0
_PANEL_TITLE_MM = 4.5
_BAR_MM, _BAR_GAP_MM, _BAR_TEXT_MM = 2.5, 1.2, 9.5
_TICKS_LEFT_MM, _TICKS_BELOW_MM = 10.0, 8.5
_MARGIN_MM = 1.5
_LEAST_AXES_MM = 22.0
"""Least width of a panel's axes: the numbers below narrower axes would overlap."""


@dataclass(frozen=True)
class Layout:
    """The places of panels of equal size, and of their colour bars: one for each panel, or one for all.

    Attributes
    ----------
    number, columns : int
        Number of panels, and of panels in a row.
    width_mm : float
        Width of the picture.
    aspect : float
        Height of a panel's axes over their width.
    ticks : bool
        True if the axes have numbers.
    title : bool
        True if the picture has a title.
    bars : bool
        True if each panel has its own colour bar; False for a single colour bar beside all panels.
    """

    number: int
    columns: int
    width_mm: float
    aspect: float
    ticks: bool
    title: bool
    bars: bool = True

    @property
    def _cell_mm(self) -> float:
        beside = 0.0 if self.bars else _BAR_GAP_MM + _BAR_MM + _BAR_TEXT_MM
        return (self.width_mm - 2 * _MARGIN_MM - beside) / self.columns

    @property
    def _left_mm(self) -> float:
        return _TICKS_LEFT_MM if self.ticks else _MARGIN_MM

    @property
    def _axes_mm(self) -> tuple[float, float]:
        right = _BAR_GAP_MM + _BAR_MM + _BAR_TEXT_MM if self.bars else _MARGIN_MM
        width = max(self._cell_mm - self._left_mm - right, 3.0)
        return width, width * self.aspect

    @property
    def _row_mm(self) -> float:
        below = _TICKS_BELOW_MM if self.ticks else _MARGIN_MM
        return _PANEL_TITLE_MM + self._axes_mm[1] + below

    def readable(self) -> "Layout":
        """Return this layout, with fewer panels in a row if the axes of the panels would be too small."""
        layout = self
        while layout.columns > 1 and layout._axes_mm[0] < _LEAST_AXES_MM:
            layout = replace(layout, columns=layout.columns - 1)
        return layout

    @property
    def rows(self) -> int:
        """Number of rows of panels."""
        return -(-self.number // self.columns)

    @property
    def height_mm(self) -> float:
        """Height of the picture."""
        return 2 * _MARGIN_MM + (_TITLE_MM if self.title else 0.0) + self.rows * self._row_mm

    def new_figure(self) -> Any:
        """Return an empty matplotlib figure of the picture's size."""
        from matplotlib.figure import Figure

        return Figure(figsize=(self.width_mm / MM_PER_IN, self.height_mm / MM_PER_IN))

    def add_axes(self, figure: Any, index: int) -> Any:
        """Add the axes of a panel to the figure."""
        row, column = divmod(index, self.columns)
        width, height = self._axes_mm
        left = _MARGIN_MM + column * self._cell_mm + self._left_mm
        return figure.add_axes(self._rectangle(left, self._top_mm(row) + _PANEL_TITLE_MM, width, height))

    def add_bar(self, figure: Any, index: int) -> Any:
        """Add the axes for the colour bar of a panel, or for the common colour bar if `bars` is False."""
        row, column = divmod(index, self.columns)
        width, height = self._axes_mm
        if self.bars:
            left = _MARGIN_MM + column * self._cell_mm + self._left_mm + width + _BAR_GAP_MM
            top = self._top_mm(row) + _PANEL_TITLE_MM
        else:
            left = _MARGIN_MM + self.columns * self._cell_mm + _BAR_GAP_MM
            top = self._top_mm(0) + _PANEL_TITLE_MM
            height = min(self.height_mm - top - _MARGIN_MM, 80.0)
        return figure.add_axes(self._rectangle(left, top, _BAR_MM, height))

    def _top_mm(self, row: int) -> float:
        return _MARGIN_MM + (_TITLE_MM if self.title else 0.0) + row * self._row_mm

    def _rectangle(self, left: float, top: float, width: float, height: float) -> list[float]:
        """Return a rectangle in matplotlib's form: fractions of the figure, from its lower left corner."""
        bottom = self.height_mm - top - height
        return [
            left / self.width_mm,
            bottom / self.height_mm,
            width / self.width_mm,
            height / self.height_mm,
        ]
