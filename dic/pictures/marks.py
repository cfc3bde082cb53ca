"""What a page consists of: rectangles, lines, dots and text, in millimetres from its upper left corner."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from dic.typing import Float

MARGIN_MM = 1.5
"""Free space at the edges of a page."""
MM_PER_IN = 25.4
PT_PER_IN = 72.0
FONT_PT = 7.0
CAPITAL_MM = 0.257
"""Height of a capital letter or a digit of 1 pt."""

Colour = tuple[int, int, int]
"""Red, green and blue from 0 to 255."""
INK: Colour = (30, 30, 30)
"""Colour of lines and text."""

Frame = NDArray[np.uint8]
"""Red, green and blue of each pixel, shape (height, width, 3)."""


@dataclass(frozen=True)
class Rect:
    """A rectangle of a page, in mm from the upper left corner."""

    left: float
    top: float
    width: float
    height: float

    def px(self, dpi: float) -> tuple[int, int, int, int]:
        """Return left, top, width and height in whole pixels."""
        sides = (self.left, self.top, self.width, self.height)
        left, top, width, height = (round(side / MM_PER_IN * dpi) for side in sides)
        return left, top, max(1, width), max(1, height)

    def on_pixels(self, dpi: float) -> "Rect":
        """Return the rectangle with its edges between pixels."""
        return Rect(*(side * MM_PER_IN / dpi for side in self.px(dpi)))

    def fitted(self, aspect: float, dpi: float) -> "Rect":
        """Return the largest rectangle of an aspect (height over width) in the middle of this one."""
        width = min(self.width, self.height / aspect)
        left, top = self.left + (self.width - width) / 2, self.top + (self.height - width * aspect) / 2
        return Rect(left, top, width, width * aspect).on_pixels(dpi)

    @property
    def middle(self) -> tuple[float, float]:
        """The middle of the rectangle."""
        return self.left + self.width / 2, self.top + self.height / 2

    def outline(self) -> Float:
        """Return the corners, shape (5, 2); the last is the first."""
        right, bottom = self.left + self.width, self.top + self.height
        corners = [(self.left, self.top), (right, self.top), (right, bottom), (self.left, bottom)]
        return np.array([*corners, corners[0]])


@dataclass(frozen=True)
class Text:
    """A line of text: the place of its baseline's left end, middle or right end in mm, and its size."""

    x: float
    y: float
    text: str
    size_pt: float = FONT_PT
    align: Literal["left", "center", "right"] = "left"
    upright: bool = False
    """True if the text reads from below to above."""
    boxed: bool = False
    """True for a white box behind the text."""


@dataclass(frozen=True)
class Line:
    """Straight lines between places (n, 2) in mm."""

    places: Float
    width_pt: float = 0.5
    colour: Colour = INK


@dataclass(frozen=True)
class Dots:
    """Equal squares around places (n, 2) in mm."""

    places: Float
    width_pt: float
    colour: Colour
