"""Strain-gauge areas, to which an affine displacement is fitted."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from dic.errors import Check
from dic.gauges.declared import MOST, Gauge, Pair, Placed, angle_check, is_pair, place_check
from dic.typing import Float

if TYPE_CHECKING:
    from dic.gauges.points import GridPlaces


@dataclass(frozen=True, kw_only=True)
class StrainGauge(Gauge):
    """An area to which an affine displacement is fitted: a rectangle, or a polygon.

    Attributes
    ----------
    centre, size : tuple of float, or None
        Centre of a rectangle, and its width and height; None for a polygon.
    angle_deg : float
        Angle by which the rectangle is turned about its centre.
    corners : tuple of (float, float), or None
        Corners of a polygon; None for a rectangle.
    direction_deg : float
        Direction of the engineering strain `strain`: 0 for x, 90 for y.
    """

    kind = "area"
    plural = "strain-gauge areas"

    centre: Pair | None = None
    size: Pair | None = None
    angle_deg: float = 0.0
    corners: tuple[Pair, ...] | None = None
    direction_deg: float = 0.0

    def _checks(self) -> list[Check]:
        angles = [angle_check(name, getattr(self, name)) for name in ("angle_deg", "direction_deg")]
        rectangle = self.centre is not None and self.size is not None
        given = [name for name in ("centre", "size", "corners") if getattr(self, name) is not None]
        if self.corners is not None:
            alone = given == ["corners"] and self.angle_deg == 0.0
            remedy = "give corners = [[100, 100], [300, 100], [200, 300]] and no centre, size or angle_deg"
            return [(alone and _is_polygon(self.corners), "corners", "three or more places, alone",
                     self.corners if alone else ", ".join(given), remedy), *angles]  # fmt: skip
        if not rectangle:
            remedy = "give centre = [200, 200] and size = [100, 50], or corners"
            got = ", ".join(given) or "neither"
            return [(False, "area", "centre and size, or corners", got, remedy), *angles]
        sides = is_pair(self.size) and all(0.0 < side < MOST for side in self.size or ())
        remedy = "give width and height, such as size = [100, 50]"
        return [
            place_check("centre", self.centre),
            (sides, "size", "a width and a height above 0", self.size, remedy),
            *angles,
        ]

    @property
    def outline(self) -> Float:
        """Corners of the area, shape (n, 2), in the gauge's unit with the second coordinate upwards."""
        if self.corners is not None:
            return self.upwards(self.corners)
        angle = np.radians(self.angle_deg)
        axes = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        half = 0.5 * np.asarray(self.size) * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
        return np.asarray(self.upwards(self.centre) + half @ axes)

    @property
    def middle(self) -> Float:
        """Centroid of the area, shape (2,), in the gauge's unit with the second coordinate upwards."""
        start = self.outline
        origin, end = start.mean(axis=0), np.roll(start, -1, axis=0)
        a, b = start - origin, end - origin
        twice = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
        whole = float(twice.sum())
        if abs(whole) <= 1e-9 * float(np.abs(twice).sum()):
            # Sides that cross, as in the figure 8, may enclose no area.
            return np.asarray(origin)
        return np.asarray(origin + twice @ (a + b) / (3.0 * whole))

    def drawn_lines(self) -> list[Float]:
        """Return the closed outline."""
        return [np.concatenate([self.outline, self.outline[:1]])]

    def drawn_shape(self) -> tuple[str, Sequence[Pair], dict[str, Any]]:
        """Return a polygon or a rectangle."""
        if self.centre is None or self.size is None:
            return "polygon", self.corners or (), {"direction_deg": self.direction_deg}
        width_px, height_px = self.size
        sizes = {"width_px": width_px, "height_px": height_px}
        angles = {"angle_deg": self.angle_deg, "direction_deg": self.direction_deg}
        return "rectangle", [self.centre], sizes | angles

    def placed(self, places: "GridPlaces", window_points: int) -> Placed:
        """Find the gauge's points in the grid of measured points."""
        from dic.gauges.fits import PlacedFit, require_points

        chosen = places.in_polygon(self.outline)
        require_points(self, len(chosen), places, "enlarge the area")
        pieces = places.pieces(chosen)
        reason = ""
        if pieces > 1:
            reason = f"a crack or a gap divides the area into {pieces} pieces, and its opening is not strain"
        return PlacedFit.of(chosen, places, self.middle, self.direction_deg, reason)


def _is_polygon(corners: object) -> bool:
    whole = isinstance(corners, list | tuple) and len(corners) >= 3
    return whole and all(is_pair(corner) for corner in corners)  # type: ignore[attr-defined]  # a sequence
