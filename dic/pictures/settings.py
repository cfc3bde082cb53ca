"""Settings of maps: the quantities, the image, the axes, the colours, the size and the resolution."""

from collections.abc import Iterable, Mapping, Sequence
from math import isfinite
from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator

from dic.errors import Check, CorrelationError, OutputError, require_all
from dic.settings import Names, Number, names_of, one_of, setting, settings_class

QUANTITIES = ("u", "v", "exx", "eyy", "exy")
"""The quantities that a map can show: displacement to the right and upwards, and three strains."""

COLOURS = ("viridis", "cividis", "inferno", "grey", "diverging")
"""Names of colour maps.

Colour-blind people can read all these colour maps. In the first four, the lightness grows evenly with the
value. "diverging" is white at zero.
"""

FORMATS = ("png", "pdf", "svg")
"""Formats of pictures by the endings of their names."""
ON = ("reference", "deformed")
AXES = ("auto", "mm", "px", "off")
SCALES = ("series", "image")
KINDS = ("best", "corrected", "calibrated", "raw")
_SIDES_MM = (20.0, 2000.0)
_DPI = (20, 1200)
_MOST_WIDTH_PX = 12_000
"""A wider picture takes gigabytes of memory while it is drawn."""


def _as_mapping(value: Any) -> Any:
    pairs = isinstance(value, tuple) and not any(isinstance(each, str) for each in value)
    return dict(value) if pairs else value


Limits = Annotated[Mapping[str, tuple[float, float]], BeforeValidator(_as_mapping)]
"""Lower and upper ends of scales by the names of their quantities."""


def _scale_of(text: str) -> tuple[str, tuple[float, float]]:
    """Return the quantity and the ends of its scale of the text "QUANTITY=LOW,HIGH"."""
    quantity, _, ends = text.partition("=")
    low, high = (float(end) for end in ends.split(","))
    return quantity, (low, high)


def _side_mm(default: float, what: str, sentence: str, remedy: str) -> Any:
    low, high = _SIDES_MM
    expected = f"{low:g} to {high:g} mm"
    return setting(what, sentence, default=default, expected=expected, remedy=remedy, ge=low, le=high)


def width_mm(default: float, pictures: str) -> Any:
    """Declare the width of pictures, which messages call `pictures`, mm."""
    remedy = "give 85 for a column of a paper, 250 for a screen"
    return _side_mm(default, f"width of {pictures}", "Width of a picture on paper.", remedy)


def dpi(default: int, pictures: str) -> Any:
    """Declare the resolution of pictures, which messages call `pictures`, points per inch."""
    return setting(
        f"resolution of {pictures}",
        "Resolution of a picture, points per inch.",
        default=default,
        expected=f"{_DPI[0]} to {_DPI[1]} points per inch",
        remedy="give 150 for a screen, 300 for print",
        ge=_DPI[0],
        le=_DPI[1],
    )


def _choice(default: str, what: str, sentence: str, names: Iterable[str], remedy: str) -> Any:
    return setting(what, sentence, default=default, expected=one_of(names), remedy=remedy, among=names)


@settings_class(CorrelationError)
class MapSettings:
    """Settings of maps of displacement and strain."""

    quantities: Names = setting(
        "quantities of maps",
        f"Quantities to draw, some of {', '.join(QUANTITIES)}.",
        default=QUANTITIES,
        expected=f"some of {', '.join(QUANTITIES)}",
        remedy="give for example exx,eyy",
        read=names_of,
        check=lambda names: bool(names) and set(names) <= set(QUANTITIES),
    )
    kind: str = _choice(
        "best",
        "kind of values of maps",
        "Kind of values: raw, calibrated, corrected, or best (the best that an image has).",
        KINDS,
        "give best",
    )
    on: str = _choice(
        "reference",
        "image under maps",
        "Image under the maps: reference or deformed.",
        ON,
        "give deformed to draw points at their new places",
    )
    axes: str = _choice(
        "auto",
        "axes of maps",
        "Axes of the maps: mm, px, off, or auto (mm with a calibration).",
        AXES,
        "give mm with a calibration, px without one",
    )
    scale: str = _choice(
        "series",
        "scale of maps",
        "Scale of the colours: series (the same in all images) or image (each image its own).",
        SCALES,
        "give series to compare the images of a series",
    )
    limits: Limits = setting(
        "limits of maps",
        "Ends of a quantity's scale in px, mm or µε, such as eyy=0,2000. May be repeated.",
        default={},
        expected=f"{one_of(QUANTITIES)} with a lower and a greater upper end",
        remedy="give for example eyy=0,2000 (strain in µε)",
        metavar="QUANTITY=LOW,HIGH",
        read=_scale_of,
        several=True,
        check=lambda limits: all(map(_is_scale, limits, limits.values())),
    )
    colours: str = _choice(
        "viridis",
        "colours of maps",
        "Colour scale: viridis, cividis, inferno, grey, or diverging (white at zero).",
        COLOURS,
        "give viridis",
    )
    opacity: Number = setting(
        "opacity of maps",
        "Opacity of the colours over the image.",
        default=0.85,
        expected="a number above 0, at most 1",
        remedy="give 0.85",
        gt=0.0,
        le=1.0,
    )
    width_mm: Number = width_mm(250.0, "maps")
    dpi: Number = dpi(150, "maps")

    def __post_init__(self) -> None:
        require_all(CorrelationError, "settings", [pixels_check("maps", self.width_mm, self.dpi)])

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


@settings_class(CorrelationError)
class PlotSettings:
    """Size and resolution of a picture of lines; the height is that of one panel."""

    width_mm: Number = width_mm(160.0, "plots")
    height_mm: Number = _side_mm(100.0, "height of plots", "Height of each panel on paper.", "give 100")
    dpi: Number = dpi(200, "plots")

    def __post_init__(self) -> None:
        require_all(CorrelationError, "settings", [pixels_check("plots", self.width_mm, self.dpi)])


def pixels_check(pictures: str, width_mm: float, dpi: float) -> Check:
    """Return the check of the number of pixels of pictures, which the messages call `pictures`."""
    return (
        width_mm / 25.4 * dpi <= _MOST_WIDTH_PX,
        f"width and resolution of {pictures}",
        f"at most {_MOST_WIDTH_PX} px together",
        f"{width_mm} mm at {dpi} points per inch",
        "give a smaller width or resolution, such as 250 mm at 300",
    )


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


def _is_scale(quantity: str, ends: tuple[float, float]) -> bool:
    return quantity in QUANTITIES and len(ends) == 2 and all(map(isfinite, ends)) and ends[0] < ends[1]
