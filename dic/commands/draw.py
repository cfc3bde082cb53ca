"""The command `dic draw`, which writes a page on which regions and gauges are drawn over an image."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import click

import dic
from dic.errors import CorrelationError
from dic.shell.console import say
from dic.shell.output_paths import FORCE, PATH, require_places

_RUN_FILES = (".h5", ".hdf5")


@click.command()
@click.argument("image", type=PATH)
@click.option("--camera", help="Camera of a run file, if the run has several.")
@click.option("-o", "--output", type=PATH, help="HTML file.  [default: IMAGE-drawing.html]")
@click.option("--roi", type=PATH, help="Region to begin with: mask image or region file.")
@click.option("--specimen", is_flag=True, help="Begin with the specimen, found by its speckles.")
@click.option(
    "--gauges",
    "gauges_file",
    type=PATH,
    help="TOML file of gauges to begin with; gauges in mm are not changed.",
)
@click.option(
    "--calibration",
    "calibration_file",
    type=PATH,
    help="Calibration file: the page then also shows the pointer's place in mm.",
)
@FORCE
def draw(
    image: Path,
    camera: str | None,
    output: Path | None,
    roi: Path | None,
    specimen: bool,
    gauges_file: Path | None,
    calibration_file: Path | None,
    force: bool,
) -> None:
    """Write a page on which you draw regions, cracks and gauges over IMAGE in a browser.

    IMAGE is an image file, or a run file, of which the page shows the reference image of a camera.
    The page is one HTML file that works offline. The page saves region.toml for --roi of `dic correlate`,
    `dic process`, `dic quality` and `dic study`, and gauges.toml for --gauges of `dic correlate`,
    `dic process` and `dic gauges`.
    """
    if roi is not None and specimen:
        remedy = "leave one of them out"
        raise CorrelationError("settings", "--specimen", "no --roi beside it", str(roi), remedy)
    given = _given(image, camera)
    page = output or Path(f"{given.stem}-drawing.html")
    require_places([image, roi, gauges_file, calibration_file], [page], force=force)
    gauges = () if gauges_file is None else dic.read_gauges(gauges_file)
    calibration = given.calibration if calibration_file is None else dic.load_calibration(calibration_file)
    region = _specimen(given.image) if specimen else roi
    dic.drawing.write_drawing_page(
        given.image, page, region=region, gauges=gauges, calibration=calibration, name=given.name
    )
    say(f"page: {page}")
    say("open it in a browser, draw, and save region.toml and gauges.toml")
    say(f"then: {given.then}")


@dataclass(frozen=True)
class _Given:
    """The image to draw on, the beginning of the page's name, and the command that reads the drawn files."""

    image: dic.typing.ImageLike
    stem: str
    then: str
    name: str | None = None
    calibration: dic.Calibration | None = None


def _given(image: Path, camera: str | None) -> _Given:
    """Return an image file, or the reference image of a camera of a run file, as the image to draw on."""
    if camera is None and image.suffix.lower() not in _RUN_FILES:
        return _Given(image, image.stem, f"dic correlate {image} … --roi region.toml --gauges gauges.toml")
    of_run = dic.pipeline.run_reference(image, camera)
    then = f"dic process {image} --roi {of_run.camera}=region.toml"
    return _Given(of_run.image, f"{image.stem}-{of_run.camera}", then, of_run.name, of_run.calibration)


def _specimen(image: dic.typing.ImageLike) -> dic.typing.Mask:
    found = dic.find_specimen(image)
    say(str(found))
    return found.mask
