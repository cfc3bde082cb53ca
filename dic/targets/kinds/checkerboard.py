"""Checkerboards of dark and bright squares."""

from dataclasses import dataclass
from itertools import product

import numpy as np

from dic.keywords import named_settings
from dic.targets.checkerboard import find_checkerboard
from dic.targets.kinds.target import Hints, Target
from dic.targets.points import GridPoints
from dic.targets.sheet.shapes import Shapes
from dic.typing import Grey


@named_settings
@dataclass(frozen=True)
class CheckerboardTarget(Target):
    """A checkerboard of dark and bright squares. The points are the corners at which four squares meet.

    Attributes
    ----------
    squares : tuple of int
        Number of whole squares along X and along Y, including the squares at the rim. If one number is even
        and the other is odd, the colours determine the axes: the lower left square is dark.
    pitch_mm : float
        Length of the side of a square.
    """

    name = "checkerboard"
    title = "a checkerboard"
    printed = "checkerboard, {x} × {y} squares of {pitch_mm:g} mm."
    counted = "squares"
    option = "squares"
    option_help = "Numbers of squares of a checkerboard or ChArUco board, if used."
    fewest = 5

    squares: tuple[int, int]
    pitch_mm: float

    def find(self, grey: Grey, source: str, hints: Hints) -> GridPoints:
        """Return the inner corners."""
        return find_checkerboard(grey, self.squares, self.pitch_mm, source, hints.x_axis)

    def shapes(self) -> Shapes:
        """Return the dark squares; the lower left one is dark."""
        columns, rows = self.squares
        pitch = self.pitch_mm
        dark = [
            ((column - columns / 2) * pitch, (row - rows / 2) * pitch, pitch, pitch)
            for column, row in product(range(columns), range(rows))
            if (column + row) % 2 == 0
        ]
        return Shapes(rectangles=np.array(dark))
