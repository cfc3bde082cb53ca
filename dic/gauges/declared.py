"""The gauges that a user declares by name: extensometers, strain-gauge areas, line cuts and points.

Places are in pixels (x right, y down, from the centre of the image's first pixel) or in millimetres on the
specimen (the calibration grid's axes, X right, Y up). In both units, angles are positive from the right
upwards.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, ClassVar

import numpy as np

from dic.errors import Check, GaugeError, is_number, is_whole, require_all
from dic.typing import Float

UNITS = ("px", "mm")
LEAST_LINES = 32
"""Least number of lines of a transverse gauge; ISO 10113 recommends to average over many places."""
MOST_LINES = 10_000
_MOST = 1e6
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,39}")

Pair = tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class Gauge:
    """The name and the unit that every gauge has.

    Attributes
    ----------
    name : str
        Letters, digits, "_" and "-", at most 40, unique among the gauges of a measurement.
    unit : str
        Unit of the gauge's places and sizes, "px" or "mm".

    Raises
    ------
    GaugeError
        If a value is not possible. The message names all wrong values together.
    """

    kind: ClassVar[str] = ""

    name: str
    unit: str = "px"

    def __post_init__(self) -> None:
        require_all(GaugeError, f"gauge {self.name!r}", [*self._named(), *self._checks()])
        for item in fields(self):
            value = getattr(self, item.name)
            if isinstance(value, list | tuple):
                object.__setattr__(self, item.name, _frozen(value))

    def _named(self) -> list[Check]:
        good = isinstance(self.name, str) and _NAME.fullmatch(self.name) is not None
        return [
            (good, "name", "letters, digits, _ and -, at most 40", self.name, 'give a name such as "axial"'),
            (self.unit in UNITS, "unit", "px or mm", self.unit, 'give unit = "px", or "mm" on the specimen'),
        ]

    def _checks(self) -> list[Check]:
        return []

    def upwards(self, places: Any) -> Float:
        """Return the given places, shape (…, 2), in axes whose second coordinate points upwards."""
        return np.asarray(places, np.float64) * (1.0, -1.0 if self.unit == "px" else 1.0)


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

    kind: ClassVar[str] = "extensometer"

    start: Pair
    end: Pair
    patch: float

    def _checks(self) -> list[Check]:
        return [*_line_checks(self.start, self.end), *_patch_checks(self.start, self.end, self.patch)]


@dataclass(frozen=True, kw_only=True)
class TransverseExtensometer(Gauge):
    """Many parallel line extensometers, whose strains are averaged; for example across a specimen.

    Attributes
    ----------
    start, end : tuple of float
        Ends of the middle line.
    patch : float
        Side length of the square patch at each end of each line.
    spread : float
        Distance between the first and the last line. The middle line lies halfway between them.
    lines : int
        Number of lines, at least 32. A reading needs 32 lines with displacements at both ends.
    """

    kind: ClassVar[str] = "transverse"

    start: Pair
    end: Pair
    patch: float
    spread: float
    lines: int = 40

    def _checks(self) -> list[Check]:
        good = is_whole(self.lines) and LEAST_LINES <= self.lines <= MOST_LINES
        lines = f"a whole number from {LEAST_LINES} to {MOST_LINES}"
        return [
            *_line_checks(self.start, self.end),
            *_patch_checks(self.start, self.end, self.patch),
            _size_check("spread", self.spread),
            (good, "lines", lines, self.lines, "give lines = 40"),
        ]


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

    kind: ClassVar[str] = "area"

    centre: Pair | None = None
    size: Pair | None = None
    angle_deg: float = 0.0
    corners: tuple[Pair, ...] | None = None
    direction_deg: float = 0.0

    def _checks(self) -> list[Check]:
        angles = [_angle_check(name, getattr(self, name)) for name in ("angle_deg", "direction_deg")]
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
        sides = _is_pair(self.size) and all(0.0 < side < _MOST for side in self.size or ())
        remedy = "give width and height, such as size = [100, 50]"
        return [
            _place_check("centre", self.centre),
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

    kind: ClassVar[str] = "cut"

    start: Pair
    end: Pair
    places: int = 50
    width: float | None = None

    def _checks(self) -> list[Check]:
        good = is_whole(self.places) and 2 <= self.places <= 2000
        return [
            *_line_checks(self.start, self.end),
            (good, "places", "a whole number from 2 to 2000", self.places, "give places = 50"),
            *([] if self.width is None else [_size_check("width", self.width)]),
        ]


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

    kind: ClassVar[str] = "point"

    at: Pair
    width: float | None = None
    direction_deg: float = 0.0

    def _checks(self) -> list[Check]:
        return [
            _place_check("at", self.at),
            _angle_check("direction_deg", self.direction_deg),
            *([] if self.width is None else [_size_check("width", self.width)]),
        ]


KINDS: Mapping[str, type[Gauge]] = {
    kind.kind: kind for kind in (Extensometer, TransverseExtensometer, StrainGauge, LineCut, PointGauge)
}
"""The class of each kind of gauge, keyed by the name of the kind in a file."""


def _line_checks(start: object, end: object) -> list[Check]:
    checks = [_place_check("start", start), _place_check("end", end)]
    if all(check[0] for check in checks):
        apart = tuple(start) != tuple(end)  # type: ignore[arg-type]  # both were checked above
        checks.append((apart, "end", "another place than start", end, "give both ends of the line"))
    return checks


def _place_check(name: str, place: object) -> Check:
    remedy = f"give {name} = [200, 300]"
    return (_is_pair(place), name, "two finite numbers [x, y]", place, remedy)


def _size_check(name: str, size: object) -> Check:
    good = is_number(size) and 0.0 < size < _MOST  # type: ignore[operator]  # it is a number
    return (good, name, "a number above 0", size, f"give {name} = 40, in the gauge's unit")


def _patch_checks(start: object, end: object, patch: object) -> list[Check]:
    checks = [_size_check("patch", patch)]
    if checks[0][0] and _is_pair(start) and _is_pair(end):
        length = float(np.hypot(*np.subtract(end, start)))  # type: ignore[call-overload]  # both are pairs
        good = patch <= length  # type: ignore[operator]  # it is a number
        expected = f"at most {length:.4g}, the distance between start and end"
        checks.append(
            (good, "patch", expected, patch, "make the patch smaller, so that patches do not overlap")
        )
    return checks


def _angle_check(name: str, angle: object) -> Check:
    good = is_number(angle) and -360.0 <= angle <= 360.0  # type: ignore[operator]  # it is a number
    return (good, name, "from -360° to 360°", angle, f"give {name} = 90")


def _is_pair(place: object) -> bool:
    if not isinstance(place, list | tuple) or len(place) != 2:
        return False
    return all(is_number(value) and abs(value) < _MOST for value in place)


def _is_polygon(corners: object) -> bool:
    whole = isinstance(corners, list | tuple) and len(corners) >= 3
    return whole and all(_is_pair(corner) for corner in corners)  # type: ignore[attr-defined]  # a sequence


def _frozen(value: Any) -> Any:
    return tuple(map(_frozen, value)) if isinstance(value, list | tuple) else float(value)
