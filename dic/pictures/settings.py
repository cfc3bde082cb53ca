"""Settings of maps: the quantities, the image, the axes, the colours, the size and the resolution."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path
from typing import Any

from dic.errors import Check, CorrelationError, OutputError, is_number, require_all
from dic.keywords import named_settings

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

FORMATS = ("png", "pdf", "svg")
"""Formats of pictures by the endings of their names."""
ON = ("reference", "deformed")
AXES = ("auto", "mm", "px", "off")
SCALES = ("series", "image")
KINDS = ("best", "corrected", "calibrated", "raw")
_WIDTHS_MM = (20.0, 2000.0)
_DPI = (20, 1200)
_MOST_WIDTH_PX = 12_000
"""A wider picture takes gigabytes of memory while it is drawn."""


@named_settings
@dataclass(frozen=True)
class MapSettings:
    """Settings of maps of displacement and strain.

    Attributes
    ----------
    quantities : tuple of str
        The maps to draw, from "u", "v" (displacement to the right and upwards), "exx", "eyy", "exy".
    kind : str
        "raw", "calibrated" or "corrected" values. "best" shows corrected values of an image that was
        corrected, otherwise calibrated ones, or raw ones if there is no calibration.
    on : str
        The image under the maps: "reference", or "deformed", where each point is drawn at its new place.
    axes : str
        "mm" for millimetres on the specimen, "px" for pixels, "off" for a picture without axes. "auto" gives
        millimetres if there is a calibration. In millimetres the picture shows the specimen as if seen
        straight on.
    scale : str
        "series" for the same scale in all images of a series, "image" for a separate scale for each image.
    limits : mapping of str to (float, float)
        Lower and upper end of the scale of a quantity: px or mm for displacement, µε for strain, also where
        the map is labelled in %. Quantities without limits get them from `scale`.
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
    kind: str = "best"
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
            _one_of("kind of values of maps", self.kind, KINDS, "give best"),
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
            *size_checks("maps", self.width_mm, self.dpi),
            *(_limits(quantity, ends) for quantity, ends in self.limits.items()),
        ]
        require_all(CorrelationError, "settings", checks)

    @staticmethod
    def require_calibrated_values(kind: str, *, calibrated: bool) -> None:
        """Raise an error if `kind` needs a calibration, but there is none."""
        if kind in ("calibrated", "corrected") and not calibrated:
            remedy = "measure with a calibration, or leave the kind out"
            raise CorrelationError("settings", f"{kind} values in maps", "a calibration", "none", remedy)

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


def size_checks(pictures: str, width_mm: object, dpi: object) -> list[Check]:
    """Return the checks of the width and the resolution of pictures, which the messages call `pictures`."""
    numbers = is_number(width_mm), is_number(dpi)
    width: Any = width_mm
    points: Any = dpi
    return [
        (
            numbers[0] and _WIDTHS_MM[0] <= width <= _WIDTHS_MM[1],
            f"width of {pictures}",
            f"{_WIDTHS_MM[0]:g} to {_WIDTHS_MM[1]:g} mm",
            width_mm,
            "give 85 for a column of a paper, 250 for a screen",
        ),
        (
            numbers[1] and _DPI[0] <= points <= _DPI[1],
            f"resolution of {pictures}",
            f"{_DPI[0]} to {_DPI[1]} points per inch",
            dpi,
            "give 150 for a screen, 300 for print",
        ),
        (
            not all(numbers) or width / 25.4 * points <= _MOST_WIDTH_PX,
            f"width and resolution of {pictures}",
            f"at most {_MOST_WIDTH_PX} px together",
            f"{width_mm} mm at {dpi} points per inch",
            "give a smaller width or resolution, such as 250 mm at 300",
        ),
    ]


def require_format(path: str | Path, formats: Sequence[str] = FORMATS) -> str:
    """Return the format that the ending of a picture's name gives.

    Raises
    ------
    OutputError
        If the format is not one of `formats`.
    """
    found = Path(path).suffix.lstrip(".").lower()
    if found not in formats:
        endings = ", ".join(f".{name}" for name in formats)
        remedy = f"give for example {Path(path).stem}.{formats[0]}"
        got = Path(path).suffix or "a name without an ending"
        raise OutputError(str(path), "write a picture", f"a name that ends with {endings}", got, remedy)
    return found


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
