"""Plates of round dots in rows of which every second one is shifted."""

from dataclasses import dataclass

import numpy as np

from dic.errors import Check
from dic.keywords import named_settings
from dic.targets.asymmetric_dots import find_asymmetric_dots
from dic.targets.kinds.target import Hints, SeenTarget, Target
from dic.targets.points import GridPoints
from dic.targets.sheet.shapes import DOT_RADIUS, Shapes, places
from dic.typing import Grey

# Smallest number of rows, and of all dots.
_FEWEST_ROWS, _FEWEST_DOTS = 4, 16


@named_settings
@dataclass(frozen=True)
class AsymmetricDotTarget(Target):
    """Round dots in rows; every second row is shifted by half a pitch, as in OpenCV's asymmetric grid of
    circles.

    Four dots in each of four rows, ``dots=(4, 4)``::

        ●   ●   ●   ●          ┐ half a pitch
          ●   ●   ●   ●        ┘
        ●   ●   ●   ●
          ●   ●   ●   ●
        └───┘
        one pitch

    The X axis points along the rows. If the number of rows is odd, the dots determine the direction of X: the
    top row and the bottom row begin at the left. If the number of rows is even, the grid looks the same after
    half a turn.

    Attributes
    ----------
    dots : tuple of int
        Number of dots in each row, and number of rows. OpenCV counts them in the same way and order.
    pitch_mm : float
        Distance between the centres of neighbouring dots of a row. Neighbouring rows are half a pitch apart.
        OpenCV's examples call half a pitch the size of a square.
    """

    name = "asymmetric-dots"
    title = "an asymmetric grid"
    printed = "asymmetric dots, {x} in each of {y} rows, pitch {pitch_mm:g} mm along a row."
    counted = "dots"
    option = "asymmetric-dots"
    option_help = "Dots in a row and rows of an asymmetric grid of dots, such as 4x11, if used."
    fewest = 3
    about = "every second row is shifted by half a pitch, as in OpenCV's asymmetric grid of circles"
    about_counts = "dots in a row and rows"

    dots: tuple[int, int]
    pitch_mm: float

    def find(self, grey: Grey, source: str, hints: Hints) -> GridPoints:
        """Return the centres of the dots."""
        return find_asymmetric_dots(grey, self.dots, self.pitch_mm, source, hints.x_axis)

    def is_shown_as(self, seen: SeenTarget) -> bool:
        """Return True for a grid of the same dots in a row and rows, in this order."""
        return super().is_shown_as(seen) and seen.counts == tuple(self.dots)

    @property
    def is_possible(self) -> bool:
        """True if there are enough dots to see that the rows are shifted."""
        in_row, rows = self.dots
        return in_row >= self.fewest and rows >= _FEWEST_ROWS and in_row * rows >= _FEWEST_DOTS

    def _checks(self) -> list[Check]:
        return [
            (
                self.is_possible,
                "number of dots",
                f"at least {self.fewest} in each row, {_FEWEST_ROWS} rows and {_FEWEST_DOTS} dots",
                f"{self.dots[0]} × {self.dots[1]}",
                "give --asymmetric-dots 4x11",
            )
        ]

    def shapes(self) -> Shapes:
        """Return the dots; the top row begins at the left."""
        half = self.pitch_mm / 2
        x, y = places(2 * self.dots[0], half), places(self.dots[1], half)
        # Neighbouring dots are 0.71 pitches apart, so their radius is smaller by this factor.
        radius = DOT_RADIUS * np.sqrt(2) * half
        discs = [(across, up, radius) for row, up in enumerate(y[::-1]) for across in x[row % 2 :: 2]]
        return Shapes(discs=np.array(discs, np.float64))
