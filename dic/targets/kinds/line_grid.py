"""Grids of equidistant lines."""

from dataclasses import dataclass

import numpy as np

from dic.errors import Check
from dic.keywords import named_settings
from dic.targets.kinds.target import Hints, Target
from dic.targets.line_grid.find import FEWEST_LINES, find_grid
from dic.targets.points import GridPoints
from dic.targets.sheet.shapes import Shapes, places
from dic.typing import Grey

# Sizes in pitches: width of a line, length of a line beyond the outermost line, radius of the mark's dots.
_LINE_WIDTH, _OVERHANG, _MARK_RADIUS = 0.15, 0.2, 0.15


@named_settings
@dataclass(frozen=True)
class LineGridTarget(Target):
    """A grid of equidistant lines in two directions, with or without a mark of its origin and axes.

    The module `dic.targets.line_grid.mark` describes the mark.

    Attributes
    ----------
    lines : tuple of int
        Number of lines along X and along Y.
    pitch_mm : float
        Distance between neighbouring lines.
    """

    name = "lines"
    title = "a line grid"
    printed = "line grid, {x} × {y} lines, pitch {pitch_mm:g} mm."
    counted = "lines"
    option = "lines"
    option_help = "Numbers of lines of a line grid.  [default: 21x21]"
    fewest = FEWEST_LINES
    takes_origin = True

    lines: tuple[int, int] = (21, 21)
    pitch_mm: float = 0.5

    def find(self, grey: Grey, source: str, hints: Hints) -> GridPoints:
        """Return the intersections of the lines."""
        return find_grid(grey, self.lines, self.pitch_mm, source, **hints._asdict())

    def _checks(self) -> list[Check]:
        # The function `find_grid` checks the numbers of lines.
        return []

    def shapes(self) -> Shapes:
        """Return the lines, and the mark of the origin and axes."""
        pitch, width = self.pitch_mm, _LINE_WIDTH * self.pitch_mm
        x, y = (places(count, pitch) for count in self.lines)
        end_x, end_y = x[-1] + _OVERHANG * pitch, y[-1] + _OVERHANG * pitch
        upright = [(place - width / 2, -end_y, width, 2 * end_y) for place in x]
        level = [(-end_x, place - width / 2, 2 * end_x, width) for place in y]
        middle_x, middle_y = x[self.lines[0] // 2], y[self.lines[1] // 2]
        discs = [
            (middle_x + right * pitch / 2, middle_y + up * pitch / 2, _MARK_RADIUS * pitch)
            for right, up in ((-1, -1), (-1, 1), (1, -1))
        ]
        return Shapes(rectangles=np.array(upright + level), discs=np.array(discs))
