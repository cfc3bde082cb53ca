"""Line cuts: displacement and strain along a line."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from dic.errors import Check, is_whole
from dic.gauges.declared import Gauge, Pair, Placed, line_checks, size_check

if TYPE_CHECKING:
    from dic.gauges.points import GridPlaces


@dataclass(frozen=True, kw_only=True)
class LineCut(Gauge):
    """Displacement and strain along a line, at equally spaced places.

    Attributes
    ----------
    start, end : tuple of float
        The first and the last place.
    places : int
        Number of places, from 2 to 2000.
    width : float or None
        Side length of the square around each place. An affine displacement is fitted to the points in the
        square. None to use the window of local strain.
    """

    kind = "cut"
    plural = "line cuts"
    is_profile = True
    is_axial = False

    start: Pair
    end: Pair
    places: int = 50
    width: float | None = None

    def _checks(self) -> list[Check]:
        good = is_whole(self.places) and 2 <= self.places <= 2000
        return [
            *line_checks(self.start, self.end),
            (good, "places", "a whole number from 2 to 2000", self.places, "give places = 50"),
            *([] if self.width is None else [size_check("width", self.width)]),
        ]

    def placed(self, places: "GridPlaces", window_points: int) -> Placed:
        """Find the gauge's points in the grid of measured points."""
        from dic.gauges.cuts import PlacedCut

        return PlacedCut.of(self, self.places, self.width, places, window_points)
