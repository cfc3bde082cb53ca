"""Line extensometers: the change of the distance between two patches of the surface."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dic.errors import Check
from dic.gauges.declared import Gauge, Pair, Placed, is_pair, line_checks, size_check, square
from dic.typing import Float

if TYPE_CHECKING:
    from dic.gauges.points import GridPlaces


@dataclass(frozen=True, kw_only=True)
class Extensometer(Gauge):
    """A line extensometer: the distance between two patches of the surface.

    Attributes
    ----------
    start, end : tuple of float
        Coordinates of the centres of the two patches.
    patch : float
        Side length of the square patches. One side is parallel to the line.
    """

    kind = "extensometer"
    plural = "extensometers"

    start: Pair
    end: Pair
    patch: float

    def _checks(self) -> list[Check]:
        return [*line_checks(self.start, self.end), *_patch_checks(self.start, self.end, self.patch)]

    @property
    def direction_deg(self) -> float:
        """Direction of the line, degrees from right to upwards."""
        start, end = self.declared_places()
        return float(np.degrees(np.arctan2(*(end - start)[::-1])))

    @property
    def offsets(self) -> Float:
        """Distances of the gauge's lines from the line between start and end."""
        return np.zeros(1)

    def drawn_lines(self) -> list[Float]:
        """Return the line and both patches."""
        start, end = ends = self.declared_places()
        return [ends, *(square(at, self.patch, end - start) for at in ends)]

    def placed(self, places: "GridPlaces", window_points: int) -> Placed:
        """Find the gauge's points in the grid of measured points."""
        from dic.gauges.lines import PlacedLines

        return PlacedLines.of(self, self.patch, self.offsets, places)


def _patch_checks(start: object, end: object, patch: object) -> list[Check]:
    checks = [size_check("patch", patch)]
    if checks[0][0] and is_pair(start) and is_pair(end):
        length = float(np.hypot(*np.subtract(end, start)))  # type: ignore[call-overload]  # both are pairs
        good = patch <= length  # type: ignore[operator]  # it is a number
        expected = f"at most {length:.4g}, the distance between start and end"
        checks.append(
            (good, "patch", expected, patch, "make the patch smaller, so that patches do not overlap")
        )
    return checks
