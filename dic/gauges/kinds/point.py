"""Points: displacement and strain at a place."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dic.errors import Check
from dic.gauges.declared import Gauge, Pair, Placed, angle_check, place_check, size_check, square
from dic.typing import Float

if TYPE_CHECKING:
    from dic.gauges.points import GridPlaces


@dataclass(frozen=True, kw_only=True)
class PointGauge(Gauge):
    """Displacement and strain at a place.

    Attributes
    ----------
    at : tuple of float
    width : float or None
        Side length of the square around the place. An affine displacement is fitted to the points in the
        square. None to use the window of local strain.
    direction_deg : float
        Direction of the engineering strain `strain`: 0 for x, 90 for y.
    """

    kind = "point"
    plural = "points"
    places_of = ("at",)

    at: Pair
    width: float | None = None
    direction_deg: float = 0.0

    def _checks(self) -> list[Check]:
        return [
            place_check("at", self.at),
            angle_check("direction_deg", self.direction_deg),
            *([] if self.width is None else [size_check("width", self.width)]),
        ]

    def drawn_lines(self) -> list[Float]:
        """Return the square around the place; without a width, the place."""
        (at,) = self.declared_places()
        return super().drawn_lines() if self.width is None else [square(at, self.width, np.array([1.0, 0.0]))]

    def placed(self, places: "GridPlaces", window_points: int) -> Placed:
        """Find the gauge's points in the grid of measured points."""
        from dic.gauges.fits import PlacedFit, require_points

        (at,) = self.declared_places()
        chosen = places.around(at, self.width, window_points)
        require_points(self, len(chosen), places, "enlarge its width")
        return PlacedFit.of(chosen, places, at, self.direction_deg)
