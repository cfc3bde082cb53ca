"""The options of `dic correlate` for maps and contact sheets."""

from pathlib import Path

from dic.commands.options import Chosen, all_of, option, options, use
from dic.errors import CorrelationError
from dic.pictures import FORMATS, QUANTITIES, MapSettings
from dic.settings import either


@options
class MapOutputs:
    """Options for the files of maps."""

    folder: Path | None = option("--maps", help="Folder for one picture of maps per image.", common=True)
    file_format: str = option("--map-format", default="png", help=f"Format: {either(FORMATS)}.")
    sheets: tuple[str, ...] = option(
        "--contact-sheet",
        multiple=True,
        metavar="QUANTITY=FILE",
        help="Picture with a small map of a quantity for each image, such as eyy=sheet.png. May be repeated.",
    )

    def settings(self, drawn: Chosen[MapSettings], *, calibrated: bool) -> MapSettings:
        """Return the settings of the maps; `calibrated` is True if there is a calibration for mm."""
        settings: MapSettings
        settings, *_ = all_of(
            drawn.settings,
            self._require_format,
            self.contact_sheets,
            lambda: MapSettings.require_calibration(drawn.values["axes"], calibrated=calibrated),
            lambda: MapSettings.require_calibrated_values(drawn.values["kind"], calibrated=calibrated),
        )
        return settings

    def contact_sheets(self) -> dict[str, Path]:
        """Return the file of each contact sheet, keyed by the quantity that the sheet shows."""
        found = {}
        for text in self.sheets:
            quantity, _, file = text.partition("=")
            known = quantity in QUANTITIES and quantity not in found
            if not known or Path(file).suffix.lstrip(".") not in FORMATS:
                raise CorrelationError(
                    "settings",
                    "contact sheet",
                    f"QUANTITY=FILE, each of {','.join(QUANTITIES)} at most once, as {', '.join(FORMATS)}",
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


# These options have no effect on contact sheets, which show the reference image and have one scale.
_OF_MAPS = "format", "quantities", "on", "scale"
_OF_ALL_PICTURES = "kind", "axes", "limits", "colours", "width-mm", "dpi"

_NEEDS = {
    **{f"--map-{name}": ["--maps"] for name in _OF_MAPS},
    **{f"--map-{name}": ["--maps", "--contact-sheet"] for name in _OF_ALL_PICTURES},
}
_DRAWN = ("quantities", "kind", "on", "axes", "scale", "limits", "colours", "width_mm", "dpi")

map_outputs = use("maps", MapOutputs, needs=_NEEDS)
map_options = use("drawn", MapSettings, title="Maps", prefix="map-", only=_DRAWN)
