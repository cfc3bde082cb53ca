"""What a gauge is that a user declares by name: its places, its checks, its outlines and its readings.

Places are in pixels (x right, y down, from the centre of the image's first pixel) or in millimetres on the
specimen (the calibration grid's axes, X right, Y up). In both units, angles are positive from the right
upwards.
"""

import re
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

import numpy as np

from dic.errors import Check, GaugeError, is_number, require_all
from dic.typing import Float, Indices

if TYPE_CHECKING:
    from dic.gauges.field import GaugeField
    from dic.gauges.points import GridPlaces
    from dic.gauges.reading import Profile, Reading
    from dic.strain.displacement import Displacement

UNITS = ("px", "mm")
LEAST_LINES = 32
"""Least number of lines of a transverse gauge; ISO 10113 recommends to average over many places."""
MOST = 1e6
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,39}")
_SQUARE = 0.5 * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0]])

Pair = tuple[float, float]


class Placed(Protocol):
    """A gauge's points in the grid of measured points."""

    def points(self) -> tuple[Indices, Indices]:
        """Return the row and column indices of the points."""

    def read(self, field: "GaugeField") -> "Reading | Profile":
        """Return the gauge's reading in one displacement field."""

    def prepared(self, displacement: "Displacement", *, often: bool = False) -> "Prepared":
        """Return the gauge with those of its points that have a displacement, for all fields with the same
        points and positions; `often` if it will be read many times.
        """


class Prepared(Protocol):
    """A gauge with its points that have a displacement, as far as the displacements do not change it."""

    def read(self, field: "GaugeField") -> "Reading | Profile":
        """Return the gauge's reading in one displacement field."""


@dataclass(frozen=True, kw_only=True)
class Gauge(ABC):
    """A gauge: its name and its unit, and what each kind of gauge does in its own way.

    A kind has these attributes of its class: `kind`, its name in files; `plural`, its name in help texts;
    `places_of`, the names of its places; `is_profile`, True if it is read as a `Profile` along a line;
    `is_axial`, True if its strain can rise with the load on the specimen.

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
    plural: ClassVar[str] = ""
    places_of: ClassVar[tuple[str, ...]] = ("start", "end")
    is_profile: ClassVar[bool] = False
    is_axial: ClassVar[bool] = True

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

    def declared_places(self) -> Float:
        """Return the declared places, shape (n, 2), with the second coordinate upwards."""
        return self.upwards([getattr(self, name) for name in self.places_of])

    @property
    def outline(self) -> Float:
        """Corners of the gauge, shape (n, 2), in its unit with the second coordinate upwards."""
        return self.declared_places()

    def require_inside(self, image_shape: tuple[int, ...]) -> None:
        """Raise a GaugeError if a place in px is outside the image (height, width); mm are not checked."""
        if self.unit != "px":
            return
        corners = self.outline * (1.0, -1.0)
        height, width = image_shape
        outside = ((corners < 0.0) | (corners > (width - 1.0, height - 1.0))).any(axis=1)
        if outside.any():
            x, y = corners[outside][0]
            raise GaugeError(
                f"gauge {self.name!r}",
                "find its place",
                f"places inside the image of {width} × {height} px",
                f"({x:.4g}, {y:.4g})",
                "move the gauge into the image; x counts to the right, y downwards",
            )

    def drawn_lines(self) -> list[Float]:
        """Return the lines of a picture of the gauge, each in the same form as `outline`."""
        return [self.outline]

    def drawn_shape(self) -> tuple[str, Sequence[Pair], dict[str, Any]]:
        """Return the gauge's shape on the page of `dic draw`: its kind, its places and its other values."""
        values = {item.name: getattr(self, item.name) for item in fields(self)[2:]}
        return self.kind, [values.pop(name) for name in self.places_of], values

    @abstractmethod
    def placed(self, places: "GridPlaces", window_points: int) -> Placed:
        """Find the gauge's points; without a width of its own, in a square of `window_points` points a side.

        Raises
        ------
        GaugeError
            If there are too few points.
        """


def line_checks(start: object, end: object) -> list[Check]:
    """Return the checks of both ends of a line."""
    checks = [place_check("start", start), place_check("end", end)]
    if all(check[0] for check in checks):
        apart = tuple(start) != tuple(end)  # type: ignore[arg-type]  # both were checked above
        checks.append((apart, "end", "another place than start", end, "give both ends of the line"))
    return checks


def place_check(name: str, place: object) -> Check:
    """Return the check of a place."""
    remedy = f"give {name} = [200, 300]"
    return (is_pair(place), name, "two finite numbers [x, y]", place, remedy)


def size_check(name: str, size: object) -> Check:
    """Return the check of a length."""
    good = is_number(size) and 0.0 < size < MOST  # type: ignore[operator]  # it is a number
    return (good, name, "a number above 0", size, f"give {name} = 40, in the gauge's unit")


def angle_check(name: str, angle: object) -> Check:
    """Return the check of an angle."""
    good = is_number(angle) and -360.0 <= angle <= 360.0  # type: ignore[operator]  # it is a number
    return (good, name, "from -360° to 360°", angle, f"give {name} = 90")


def is_pair(place: object) -> bool:
    """Return True for two finite numbers."""
    if not isinstance(place, list | tuple) or len(place) != 2:
        return False
    return all(is_number(value) and abs(value) < MOST for value in place)


def square(centre: Float, width: float, along: Float) -> Float:
    """Return the outline of a square, shape (5, 2), with one side parallel to the vector `along`."""
    direction = along / np.linalg.norm(along)
    axes = np.array([direction, [-direction[1], direction[0]]])
    return np.asarray(centre + width * _SQUARE @ axes)


def _frozen(value: Any) -> Any:
    return tuple(map(_frozen, value)) if isinstance(value, list | tuple) else float(value)
