"""The dark areas of a calibration target: rectangles and discs, in mm relative to the target's centre.

X points right and Y points up.
"""

from dataclasses import dataclass, field

import numpy as np

from dic.typing import Float

DOT_RADIUS = 0.28
"""Radius of a dot, in distances between neighbouring dots."""


@dataclass(frozen=True)
class Shapes:
    """The dark areas of a target."""

    rectangles: Float = field(default_factory=lambda: np.empty((0, 4)))
    """Shape (n, 4). Left, bottom, width and height, mm."""
    discs: Float = field(default_factory=lambda: np.empty((0, 3)))
    """Shape (m, 3). X and Y of the centre, and radius, mm."""
    holes: Float = field(default_factory=lambda: np.empty((0, 3)))
    """Shape (k, 3). Bright discs within the dark discs."""

    def size_mm(self) -> tuple[float, float]:
        """Return the width and the height of the target, which is symmetric about its centre."""
        corners = [abs(self.rectangles[:, :2]), abs(self.rectangles[:, :2] + self.rectangles[:, 2:])]
        reach = np.vstack([*corners, abs(self.discs[:, :2]) + self.discs[:, 2:]]).max(axis=0)
        return 2 * float(reach[0]), 2 * float(reach[1])


def places(count: int, pitch_mm: float) -> Float:
    """Return `count` equidistant places with their middle at 0, mm."""
    found: Float = (np.arange(count, dtype=np.float64) - (count - 1) / 2) * pitch_mm
    return found
