"""Settings of maps: the quantities, the image, the axes, the colours, the size and the resolution."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isfinite

from dic.errors import Check, CorrelationError, is_number, require_all

QUANTITIES = ("u", "v", "exx", "eyy", "exy")
"""The quantities that a map can show: displacement to the right and upwards, and three strains."""

COLOURS = {
    "viridis": "viridis",
    "cividis": "cividis",
    "inferno": "inferno",
    "grey": "gray",
    "diverging": "RdBu_r",
}
"""The name of each colour map, and matplotlib's name for it.

Colour-blind people can read all these colour maps. In the first four, the lightness grows evenly with the
value. "diverging" is white at zero.
"""

ON = ("reference", "deformed")
AXES = ("auto", "mm", "px", "off")
SCALES = ("series", "image")
_WIDTHS_MM = (20.0, 2000.0)
_DPI = (20, 1200)
_MOST_WIDTH_PX = 12_000
"""A wider picture takes gigabytes of memory while it is drawn."""


@dataclass(frozen=True)
class MapSettings:
    """Settings of maps of displacement and strain.

    Attributes
    ----------
    quantities : tuple of str
        The maps to draw, from "u", "v" (displacement to the right and upwards), "exx", "eyy", "exy".
    on : str
        The image under the maps: "reference", or "deformed", where each point is drawn at its new place.
    axes : str
        "mm" for millimetres on the specimen, "px" for pixels, "off" for a picture without axes. "auto" gives
        millimetres if there is a calibration. In millimetres the picture shows the specimen as if seen
        straight on.
    scale : str
        "series" for the same scale in all images of a series, "image" for a separate scale for each image.
    limits : mapping of str to (float, float)
        Lower and upper end of the scale of a quantity, in the unit of its map: px or mm for displacement,
        µε for strain. Quantities without limits get them from `scale`.
    colours : str
        Colour map, a name in `COLOURS`.
    opacity : float
        Opacity of the colours over the image, above 0 and at most 1.
    width_mm : float
        Width of the picture in millimetres, for print.
    dpi : int
        Resolution of the picture, or of the image in a PDF or SVG file, in points per inch.
    """

    quantities: tuple[str, ...] = QUANTITIES
    on: str = "reference"
    axes: str = "auto"
    scale: str = "series"
    limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    colours: str = "viridis"
    opacity: float = 0.85
    width_mm: float = 250.0
    dpi: int = 150

    def __post_init__(self) -> None:
        checks: list[Check] = [
            (
                bool(self.quantities) and set(self.quantities) <= set(QUANTITIES),
                "quantities of maps",
                f"some of {', '.join(QUANTITIES)}",
                ", ".join(map(str, self.quantities)) or "none",
                "give for example exx,eyy",
            ),
            _one_of("image under maps", self.on, ON, "give deformed to draw points at their new places"),
            _one_of("axes of maps", self.axes, AXES, "give mm with a calibration, px without one"),
            _one_of("scale of maps", self.scale, SCALES, "give series to compare the images of a series"),
            _one_of("colours of maps", self.colours, tuple(COLOURS), "give viridis"),
            (
                is_number(self.opacity) and 0.0 < self.opacity <= 1.0,
                "opacity of maps",
                "a number above 0, at most 1",
                self.opacity,
                "give 0.85",
            ),
            (
                is_number(self.width_mm) and _WIDTHS_MM[0] <= self.width_mm <= _WIDTHS_MM[1],
                "width of maps",
                f"{_WIDTHS_MM[0]:g} to {_WIDTHS_MM[1]:g} mm",
                self.width_mm,
                "give 85 for a column of a paper, 250 for a screen",
            ),
            (
                is_number(self.dpi) and _DPI[0] <= self.dpi <= _DPI[1],
                "resolution of maps",
                f"{_DPI[0]} to {_DPI[1]} points per inch",
                self.dpi,
                "give 150 for a screen, 300 for print",
            ),
            (
                not (is_number(self.width_mm) and is_number(self.dpi))
                or self.width_mm / 25.4 * self.dpi <= _MOST_WIDTH_PX,
                "width and resolution of maps",
                f"at most {_MOST_WIDTH_PX} px together",
                f"{self.width_mm} mm at {self.dpi} points per inch",
                "give a smaller width or resolution, such as 250 mm at 300",
            ),
            *(_limits(quantity, ends) for quantity, ends in self.limits.items()),
        ]
        require_all(CorrelationError, "settings", checks)

    @staticmethod
    def require_calibration(axes: str, *, calibrated: bool) -> None:
        """Raise an error if `axes` are in mm, but there is no calibration."""
        if axes == "mm" and not calibrated:
            raise CorrelationError(
                "settings",
                "axes of maps",
                "a calibration for axes in mm",
                "none",
                "give --calibration FILE, or --map-axes px",
            )


def _one_of(name: str, value: object, known: tuple[str, ...], remedy: str) -> Check:
    return value in known, name, f"one of {', '.join(known)}", value, remedy


def _limits(quantity: str, ends: tuple[float, float]) -> Check:
    good = (
        quantity in QUANTITIES
        and len(ends) == 2
        and all(is_number(end) and isfinite(end) for end in ends)
        and ends[0] < ends[1]
    )
    expected = f"one of {', '.join(QUANTITIES)} with a lower and a greater upper end"
    got = f"{quantity}={','.join(map(str, ends))}"
    return good, "limits of maps", expected, got, "give for example eyy=0,2000 (strain in µε)"
