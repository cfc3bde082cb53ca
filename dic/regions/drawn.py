"""A region drawn by hand, and the pixels of an image that belong to it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dic.errors import CorrelationError, MeasurementError, joined
from dic.regions.crossings import EdgeCrossing, find_crossings
from dic.regions.overlaps import find_overlaps
from dic.regions.polygons import line_mask, polygon_mask
from dic.typing import Float, Mask

NARROWEST_CRACK_PX, WIDEST_CRACK_PX = 1.0, 1000.0
"""Least and largest width of a crack. A line of 1 px always separates the pixels on its two sides; a thinner
line may not.
"""

_BEYOND_PX = 1.0
"""Largest distance of a corner outside the centres of the outermost pixels; such corners include these
pixels.
"""


@dataclass(frozen=True, eq=False)
class Outline:
    """A polygon with the name of its place in the input."""

    label: str
    """The file and the number of the polygon, for error messages."""
    corners: Float
    """Shape (corners, 2). At least three corners (x, y), px."""


@dataclass(frozen=True, eq=False)
class Crack:
    """A crack or slit: a line of a given width, which does not belong to the region."""

    label: str
    """The file and the number of the crack, for error messages."""
    path: Float
    """Shape (places, 2). At least two places (x, y) that straight lines connect, px."""
    width_px: float
    """Width of the line, from 1 to 1000 px. Pixels whose centre is at most half of this width away are left
    out.
    """


@dataclass(frozen=True, eq=False)
class DrawnRegion:
    """A region drawn by hand.

    A pixel belongs to the region if its centre lies inside an odd number of polygons, in no hole, and in no
    crack. So a polygon inside another polygon is also a hole, but only `holes` may cross the outline of a
    polygon.
    """

    polygons: Sequence[Outline]
    """At least one polygon."""
    holes: Sequence[Outline] = ()
    cracks: Sequence[Crack] = ()
    sizes: Sequence[tuple[str, tuple[int, int]]] = ()
    """Width and height of the images on which parts of the region were drawn, px, with the names of the files
    that state them.
    """

    @classmethod
    def of(cls, parts: Sequence["DrawnRegion"]) -> "DrawnRegion":
        """Return one region with the polygons, holes and cracks of several regions."""
        return cls(
            [one for part in parts for one in part.polygons],
            [one for part in parts for one in part.holes],
            [one for part in parts for one in part.cracks],
            [one for part in parts for one in part.sizes],
        )

    def mask(self, shape: tuple[int, ...]) -> Mask:
        """Return the region as a mask, shape (height, width), that is True at its pixels.

        `shape`: height and width of the image.

        Raises `CorrelationError` if a part lies outside the image, the region was drawn on an image of
        another size, or polygons cross or cover each other in part. The message names all such parts
        together.
        """
        self.require_fits(shape)
        mask = polygon_mask([one.corners for one in self.polygons], shape)
        for hole in self.holes:
            mask &= ~polygon_mask([hole.corners], shape)
        for crack in self.cracks:
            mask &= ~line_mask(crack.path, crack.width_px, shape)
        return mask

    def require_fits(self, shape: tuple[int, ...]) -> None:
        """Raise the same errors as `mask`, but without computing the mask."""
        outside, own = self._outside(shape), find_crossings([one.corners for one in self.polygons])
        # The masks of places far outside the image could have any size.
        overlaps = [] if outside else self._overlaps(own)
        if errors := [*self._wrong_sizes(shape), *outside, *self._crossings(own), *overlaps]:
            raise joined(errors)

    def _wrong_sizes(self, shape: tuple[int, ...]) -> list[MeasurementError]:
        height, width = shape
        return [
            CorrelationError(
                source,
                "image_size_px",
                f"a region drawn on an image of {width} x {height} px",
                f"{across} x {down} px",
                "draw the region on an image of this series",
            )
            for source, (across, down) in self.sizes
            if (across, down) != (width, height)
        ]

    def _outside(self, shape: tuple[int, ...]) -> list[MeasurementError]:
        height, width = shape
        places = [(one.label, one.corners) for one in (*self.polygons, *self.holes)]
        errors: list[MeasurementError] = []
        for label, points in [*places, *((crack.label, crack.path) for crack in self.cracks)]:
            high = np.array([width, height]) - 1.0 + _BEYOND_PX
            outside = ((points < -_BEYOND_PX) | (points > high)).any(axis=1)
            if outside.any():
                x, y = points[outside][0]
                expected = f"places inside the image of {width} x {height} px"
                remedy = "move it into the image; x counts to the right, y downwards"
                errors.append(CorrelationError(label, "compare with the image", expected, _at(x, y), remedy))
        return errors

    def _crossings(self, own: Sequence[EdgeCrossing]) -> list[MeasurementError]:
        holes = [find_crossings([hole.corners]) for hole in self.holes]
        selves = [(self.polygons[one.first].label, one) for one in own if one.first == one.second]
        selves += [(hole.label, one) for hole, ones in zip(self.holes, holes, strict=True) for one in ones]
        expected = "edges that do not cross each other"
        errors: list[MeasurementError] = [
            CorrelationError(
                label,
                "check the outline",
                expected,
                f"a crossing at {_at(one.x, one.y)}",
                "move the corners beside it",
            )
            for label, one in selves
        ]
        return errors + [
            self._refused_pair(
                one.first, one.second, "edges that do not cross", "a crossing", f" at {_at(one.x, one.y)}"
            )
            for one in own
            if one.first != one.second
        ]

    def _overlaps(self, crossings: Sequence[EdgeCrossing]) -> list[MeasurementError]:
        crossed = {(one.first, one.second) for one in crossings}
        return [
            self._refused_pair(first, second, "polygons side by side, or one inside the other", "an overlap")
            for first, second in find_overlaps([one.corners for one in self.polygons])
            if (first, second) not in crossed
        ]

    def _refused_pair(
        self, first: int, second: int, expected: str, got: str, place: str = ""
    ) -> MeasurementError:
        return CorrelationError(
            self.polygons[first].label,
            "compare with other polygons",
            expected,
            f"{got} with {self.polygons[second].label}{place}",
            "draw one polygon around both, or declare one of them as a hole",
        )


def _at(x: float, y: float) -> str:
    return f"({x:.5g}, {y:.5g})"
