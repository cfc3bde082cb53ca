"""The options of `dic correlate` for maps and contact sheets."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from dic.commands.option_groups import all_of, option_group
from dic.errors import CorrelationError
from dic.pictures.settings import FORMATS

if TYPE_CHECKING:
    from dic import MapSettings

_DEFAULT_QUANTITIES = "u,v,exx,eyy,exy"


@dataclass(frozen=True)
class MapOptions:
    """Options of maps: quantities, axes, scales, colours and size."""

    folder: Path | None
    file_format: str
    quantities: str
    kind: str
    on: str
    axes: str
    scale: str
    limits: tuple[str, ...]
    colours: str
    width_mm: float
    dpi: int
    sheets: tuple[str, ...]

    def settings(self, *, calibrated: bool) -> "MapSettings":
        """Return the options as `MapSettings`; `calibrated` is True if there is a calibration for mm."""
        from dic import MapSettings

        settings, limits, *_ = all_of(
            self._settings,
            lambda: limits_of(self.limits, "--map-limits"),
            self._require_format,
            self.contact_sheets,
            lambda: MapSettings.require_calibration(self.axes, calibrated=calibrated),
            lambda: MapSettings.require_calibrated_values(self.kind, calibrated=calibrated),
        )
        complete: MapSettings = replace(settings, limits=limits)
        return complete

    def _settings(self) -> "MapSettings":
        from dic import MapSettings

        return MapSettings(
            quantities=tuple(name.strip() for name in self.quantities.split(",")),
            kind=self.kind,
            on=self.on,
            axes=self.axes,
            scale=self.scale,
            colours=self.colours,
            width_mm=self.width_mm,
            dpi=self.dpi,
        )

    def contact_sheets(self) -> dict[str, Path]:
        """Return the file of each contact sheet, keyed by the quantity that the sheet shows."""
        found = {}
        for text in self.sheets:
            quantity, _, file = text.partition("=")
            known = quantity in _DEFAULT_QUANTITIES.split(",") and quantity not in found
            if not known or Path(file).suffix.lstrip(".") not in FORMATS:
                raise CorrelationError(
                    "settings",
                    "contact sheet",
                    f"QUANTITY=FILE, each of {_DEFAULT_QUANTITIES} at most once, as {', '.join(FORMATS)}",
                    text,
                    "give for example --contact-sheet eyy=sheet.png",
                )
            found[quantity] = Path(file)
        return found

    def _require_format(self) -> None:
        if self.file_format not in FORMATS:
            raise CorrelationError(
                "settings",
                "format of maps",
                f"one of {', '.join(FORMATS)}",
                self.file_format,
                "give png for a screen, pdf for print",
            )


def limits_of(texts: Sequence[str], option: str) -> dict[str, tuple[float, float]]:
    """Return the ends of the scales that the texts QUANTITY=LOW,HIGH of an option give.

    Raises
    ------
    CorrelationError
        If a text has another form.
    """
    limits = {}
    for text in texts:
        quantity, _, ends = text.partition("=")
        try:
            low, high = (float(end) for end in ends.split(","))
        except ValueError as error:
            remedy = f"give for example {option} eyy=0,2000 (strain in µε)"
            raise CorrelationError("settings", "limits of maps", "QUANTITY=LOW,HIGH", text, remedy) from error
        limits[quantity] = (low, high)
    return limits


# These options have no effect on contact sheets, which show the reference image and have one scale.
_OF_MAPS = "format", "quantities", "on", "scale"
_OF_ALL_PICTURES = "kind", "axes", "limits", "colours", "width-mm", "dpi"

map_group = option_group(
    "maps",
    MapOptions,
    click.option(
        "--maps", "folder", type=click.Path(path_type=Path), help="Folder for one picture of maps per image."
    ),
    click.option(
        "--map-format", "file_format", default="png", show_default=True, help="Format: png, pdf or svg."
    ),
    click.option(
        "--map-quantities",
        "quantities",
        default=_DEFAULT_QUANTITIES,
        show_default=True,
        help="Quantities to draw.",
    ),
    click.option(
        "--map-kind",
        "kind",
        default="best",
        show_default=True,
        help="Kind of values: raw, calibrated, corrected, or best (the best that an image has).",
    ),
    click.option(
        "--map-on",
        "on",
        default="reference",
        show_default=True,
        help="Image under the maps: reference or deformed.",
    ),
    click.option(
        "--map-axes",
        "axes",
        default="auto",
        show_default=True,
        help="Axes of the maps: mm, px, off, or auto (mm with a calibration).",
    ),
    click.option(
        "--map-scale",
        "scale",
        default="series",
        show_default=True,
        help="Scale of the colours: series (the same in all images) or image (each image its own).",
    ),
    click.option(
        "--map-limits",
        "limits",
        multiple=True,
        metavar="QUANTITY=LOW,HIGH",
        help="Ends of a quantity's scale in px, mm or µε, such as eyy=0,2000. May be repeated.",
    ),
    click.option(
        "--map-colours",
        "colours",
        default="viridis",
        show_default=True,
        help="Colour scale: viridis, cividis, inferno, grey, or diverging (white at zero).",
    ),
    click.option("--map-width-mm", "width_mm", default=250.0, show_default=True, help="Width of a picture."),
    click.option(
        "--map-dpi", "dpi", default=150, show_default=True, help="Resolution of a picture, points per inch."
    ),
    click.option(
        "--contact-sheet",
        "sheets",
        multiple=True,
        metavar="QUANTITY=FILE",
        help="Picture with a small map of a quantity for each image, such as eyy=sheet.png. May be repeated.",
    ),
    needs={
        **{f"--map-{name}": ["--maps"] for name in _OF_MAPS},
        **{f"--map-{name}": ["--maps", "--contact-sheet"] for name in _OF_ALL_PICTURES},
    },
)
