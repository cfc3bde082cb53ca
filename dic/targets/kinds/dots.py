"""Plates of round dots on a square lattice."""

from dataclasses import dataclass
from itertools import product

import numpy as np

from dic.errors import Check
from dic.keywords import named_settings
from dic.targets.dots import find_dots
from dic.targets.kinds.asymmetric_dots import AsymmetricDotTarget
from dic.targets.kinds.target import Hints, Target
from dic.targets.points import GridPoints
from dic.targets.sheet.shapes import DOT_RADIUS, Shapes, places
from dic.typing import Grey

# Radius of the hole of a hollow dot, in pitches.
_HOLE_RADIUS = 0.14
# Number of columns and rows between the rim of a plate and the marks.
_MARKS_FROM_RIM = 2


@named_settings
@dataclass(frozen=True)
class DotTarget(Target):
    """Round dots on a square lattice, darker or brighter than the background.

    If three of the dots are hollow (rings), they mark the origin, a place on the X axis and a place on the Y
    axis. The origin mark is then the origin of X and Y, and the lattice may be larger than the picture.

    Attributes
    ----------
    dots : tuple of int
        Number of dots along X and along Y. For a plate larger than the picture, all dots of the plate count.
    pitch_mm : float
        Distance between the centres of neighbouring dots.
    """

    name = "dots"
    title = "a lattice"
    printed = "dots, {x} × {y}, pitch {pitch_mm:g} mm."
    counted = "dots"
    option = "dots"
    option_help = "Numbers of dots of a dot target, if used."
    fewest = 5

    dots: tuple[int, int]
    pitch_mm: float

    def find(self, grey: Grey, source: str, hints: Hints) -> GridPoints:
        """Return the centres of the dots."""
        return find_dots(grey, self.dots, self.pitch_mm, source, hints.x_axis)

    def _checks(self) -> list[Check]:
        shifted = AsymmetricDotTarget(self.dots, self.pitch_mm)
        first, second = self.dots
        otherwise = f", or --asymmetric-dots {first}x{second} if its rows are shifted"
        return [self._enough(otherwise if shifted.is_possible else "")]

    def shapes(self) -> Shapes:
        """Return the dots; three dots of a lattice of at least 7 × 7 are hollow."""
        pitch = self.pitch_mm
        x, y = (places(count, pitch) for count in self.dots)
        discs = np.array([(across, up, DOT_RADIUS * pitch) for across, up in product(x, y)])
        first = _MARKS_FROM_RIM
        if min(self.dots) < 2 * first + 3:
            return Shapes(discs=discs)
        marks = ((x[first], y[first]), (x[-1 - first], y[first]), (x[first], y[-1 - first]))
        return Shapes(discs=discs, holes=np.array([(*mark, _HOLE_RADIUS * pitch) for mark in marks]))
