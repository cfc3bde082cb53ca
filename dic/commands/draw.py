"""The command `dic draw`, which writes a page on which regions and gauges are drawn over an image."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from dic.errors import CorrelationError
from dic.shell.console import say
from dic.shell.output_paths import FORCE, require_places

if TYPE_CHECKING:
    from dic.typing import Mask

_FILE = click.Path(path_type=Path)


@click.command()
@click.argument("image", type=_FILE)
@click.option("-o", "--output", type=_FILE, help="HTML file.  [default: IMAGE-drawing.html]")
@click.option("--roi", type=_FILE, help="Region to begin with: mask image or region file.")
@click.option("--specimen", is_flag=True, help="Begin with the specimen, found by its speckles.")
@click.option(
    "--gauges",
    "gauges_file",
    type=_FILE,
    help="TOML file of gauges to begin with; gauges in mm are not changed.",
)
@click.option(
    "--calibration",
    "calibration_file",
    type=_FILE,
    help="Calibration file: the page then also shows the pointer's place in mm.",
)
@FORCE
def draw(
    image: Path,
    output: Path | None,
    roi: Path | None,
    specimen: bool,
    gauges_file: Path | None,
    calibration_file: Path | None,
    force: bool,
) -> None:
    """Write a page on which you draw regions, cracks and gauges over IMAGE in a browser.

    The page is one HTML file that works offline. The page saves region.toml for --roi of `dic correlate`,
    `dic quality` and `dic study`, and gauges.toml for --gauges of `dic correlate` and `dic process` and for
    `dic gauges`.
    """
    from dic import load_calibration, read_gauges, write_drawing_page

    if roi is not None and specimen:
        remedy = "leave one of them out"
        raise CorrelationError("settings", "--specimen", "no --roi beside it", str(roi), remedy)
    page = output or Path(f"{image.stem}-drawing.html")
    require_places([image, roi, gauges_file, calibration_file], [page], force=force)
    gauges = () if gauges_file is None else read_gauges(gauges_file)
    calibration = None if calibration_file is None else load_calibration(calibration_file)
    region = _specimen(image) if specimen else roi
    write_drawing_page(image, page, region=region, gauges=gauges, calibration=calibration)
    say(f"page: {page}")
    say("open it in a browser, draw, and save region.toml and gauges.toml")
    say(f"then: dic correlate {image} … --roi region.toml --gauges gauges.toml")


def _specimen(image: Path) -> "Mask":
    from dic import find_specimen

    found = find_specimen(image)
    say(str(found))
    return found.mask
