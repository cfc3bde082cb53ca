"""The layout of a page of maps, in millimetres: every picture has the width that the user asks for."""

from dataclasses import dataclass
from typing import Any

MM_PER_IN = 25.4
FONT_PT = 7.0
_TITLE_MM = 5.0
_PANEL_TITLE_MM = 4.5
_BAR_MM, _BAR_GAP_MM, _BAR_TEXT_MM = 2.5, 1.2, 11.0
_TICKS_LEFT_MM, _TICKS_BELOW_MM = 10.0, 8.5
_MARGIN_MM = 1.5
_GAP_MM = 1.5
_LEAST_AXES_MM = 16.0
"""Least width of a panel's axes with numbers, which narrower axes have no place for."""
_LETTER_MM = 1.25
"""Width of a letter of 6 pt."""
_NUMBER_MM = 8.0
"""Width of an axis for each number below it."""
_MOST_NUMBERS = 5
_FITTING, _HIGHEST = 0.75, 0.9
"""Largest heights as fractions of the picture's width: of the picture if more columns can achieve it, and of
a row in any case.
"""


@dataclass(frozen=True)
class PanelLayout:
    """The places of panels of equal size, and of their colour bars: one for each panel, or one for all."""

    number: int
    columns: int
    """Number of panels, and of panels in a row."""
    width_mm: float
    """Width of the picture."""
    aspect: float
    """Height of a panel's axes over their width."""
    ticks: bool
    """True if the axes have numbers."""
    title: bool
    """True if the picture has a title."""
    bars: bool = True
    """True if each panel has its own colour bar; False for a single colour bar beside all panels."""

    @classmethod
    def fitting(
        cls, number: int, width_mm: float, aspect: float, *, ticks: bool, title: bool, bars: bool = True
    ) -> "PanelLayout":
        """Return the layout with the largest panels in a picture that is clearly wider than high.

        A high and narrow specimen gets many columns, and a wide one few. If no number of columns makes the
        picture wider than high, the layout has as many columns as can be read.
        """
        each = [
            cls(number, columns, width_mm, aspect, ticks, title, bars) for columns in range(1, number + 1)
        ]
        readable = [one for one in each if not ticks or one._width_mm >= _LEAST_AXES_MM] or each[:1]
        low = (one for one in readable if one._wanted_height_mm <= _FITTING * width_mm)
        return next(low, readable[-1])

    @property
    def most_numbers(self) -> tuple[int, int]:
        """Largest number of numbers at the horizontal and at the vertical axis of a panel."""
        across, up = (min(_MOST_NUMBERS, int(side // _NUMBER_MM)) for side in self.axes_mm)
        return max(1, across), max(1, up)

    def is_outer(self, index: int) -> tuple[bool, bool]:
        """Return whether a panel has numbers below it and at its left, because no other panel is there."""
        return index + self.columns >= self.number, index % self.columns == 0

    @property
    def _left_mm(self) -> float:
        return _MARGIN_MM + (_TICKS_LEFT_MM if self.ticks else 0.0)

    @property
    def _cell_mm(self) -> float:
        beside = 0.0 if self.bars else _BAR_GAP_MM + _BAR_MM + _BAR_TEXT_MM
        return (self.width_mm - self._left_mm - _MARGIN_MM - beside) / self.columns

    @property
    def _width_mm(self) -> float:
        """Width of a panel's axes if the height of the picture does not matter."""
        return max(self._cell_mm - (_BAR_GAP_MM + _BAR_MM + _BAR_TEXT_MM if self.bars else _GAP_MM), 3.0)

    @property
    def axes_mm(self) -> tuple[float, float]:
        """Width and height of a panel's axes."""
        most_mm = _HIGHEST * self.width_mm - self._frame_mm - _PANEL_TITLE_MM - _GAP_MM
        width = min(self._width_mm, max(most_mm, 3.0) / self.aspect)
        return width, width * self.aspect

    @property
    def letters(self) -> int:
        """Number of letters of a panel's title that fit into its cell."""
        return max(1, int(self.title_mm / _LETTER_MM))

    @property
    def title_mm(self) -> float:
        """Width for the title of a panel, which may reach over its colour bar."""
        return max(self._cell_mm - _GAP_MM, self.axes_mm[0])

    @property
    def _row_mm(self) -> float:
        return _PANEL_TITLE_MM + self.axes_mm[1] + _GAP_MM

    @property
    def _frame_mm(self) -> float:
        """Height of all parts of the picture except the rows."""
        title, below = _TITLE_MM if self.title else 0.0, _TICKS_BELOW_MM if self.ticks else 0.0
        return 2 * _MARGIN_MM + title + below

    @property
    def _wanted_height_mm(self) -> float:
        return self._frame_mm + self.rows * (_PANEL_TITLE_MM + self._width_mm * self.aspect + _GAP_MM)

    @property
    def rows(self) -> int:
        """Number of rows of panels."""
        return -(-self.number // self.columns)

    @property
    def height_mm(self) -> float:
        """Height of the picture."""
        return self._frame_mm + self.rows * self._row_mm

    def new_figure(self) -> Any:
        """Return an empty matplotlib figure of the picture's size."""
        from matplotlib.figure import Figure

        return Figure(figsize=(self.width_mm / MM_PER_IN, self.height_mm / MM_PER_IN))

    def add_axes(self, figure: Any, index: int) -> Any:
        """Add the axes of a panel to the figure."""
        row, column = divmod(index, self.columns)
        width, height = self.axes_mm
        left = self._left_mm + column * self._cell_mm
        return figure.add_axes(self._rectangle(left, self._top_mm(row) + _PANEL_TITLE_MM, width, height))

    def add_bar(self, figure: Any, index: int) -> Any:
        """Add the axes for the colour bar of a panel, or for the common colour bar if `bars` is False."""
        row, column = divmod(index, self.columns)
        width, height = self.axes_mm
        if self.bars:
            left = self._left_mm + column * self._cell_mm + width + _BAR_GAP_MM
            top = self._top_mm(row) + _PANEL_TITLE_MM
        else:
            left = self._left_mm + self.columns * self._cell_mm + _BAR_GAP_MM
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
