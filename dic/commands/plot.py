"""The command `dic plot`: pictures of gauges, of line cuts, and animations, from a result file."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from dic.commands.option_groups import option_group
from dic.commands.plot_animation import animation
from dic.commands.record_options import RecordOptions, record_options
from dic.shell.console import say
from dic.shell.output_paths import FORCE, require_places

if TYPE_CHECKING:
    from dic import GaugeSeries, PlotSettings

_PATH = click.Path(path_type=Path)


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
def plot() -> None:
    """Draw gauges against time or load, line cuts, and animations of a field, from a result file.

    `dic correlate --maps` draws maps. Sizes are in millimetres on paper. Colour-blind people can distinguish
    the colours.
    """


plot.add_command(animation)


@dataclass(frozen=True)
class SourceOptions:
    """Options of `dic plot` that choose gauges and the kinds of their values."""

    texts: tuple[str, ...]
    camera: str | None
    kinds: tuple[str, ...]

    def read(self, results: Path, gauges_file: Path | None) -> "GaugeSeries":
        """Read the chosen gauges in all images of the results."""
        from dic import measure_gauges, read_gauges

        series: GaugeSeries = measure_gauges(
            results, read_gauges(gauges_file, self.texts), camera=self.camera
        )
        return series


@dataclass(frozen=True)
class PlotOptions:
    """Options for the file and the size of a picture."""

    output: Path
    width_mm: float
    height_mm: float
    dpi: int
    force: bool

    def settings(self) -> "PlotSettings":
        """Return the size as `PlotSettings`, after a check of the file."""
        from dic import PlotSettings
        from dic.pictures.settings import require_format

        require_format(self.output)
        return PlotSettings(self.width_mm, self.height_mm, self.dpi)


source_options = option_group(
    "source",
    SourceOptions,
    click.option(
        "--gauge",
        "texts",
        multiple=True,
        metavar="TEXT",
        help='A gauge, such as "axial=extensometer start=400,200 end=400,800 patch=40". May be repeated.',
    ),
    click.option("--camera", help="Camera of a run. Default: all, if all gauges are in millimetres."),
    click.option(
        "--kind",
        "kinds",
        multiple=True,
        help="raw, calibrated or corrected. May be repeated. Default: the best there is.",
    ),
)
plot_options = option_group(
    "places",
    PlotOptions,
    click.option("-o", "--output", type=_PATH, required=True, help="Picture: .png, .pdf or .svg."),
    click.option("--width-mm", default=160.0, show_default=True, help="Width of the picture on paper."),
    click.option("--height-mm", default=100.0, show_default=True, help="Height of each panel on paper."),
    click.option("--dpi", default=200, show_default=True, help="Resolution of a PNG file, points per inch."),
    FORCE,
)


@plot.command()
@click.argument("results", type=_PATH)
@click.argument("gauges_file", type=_PATH, metavar="[GAUGES]", required=False)
@click.option("--against", default="image", show_default=True, help="Axis: image (its number), time or load.")
@click.option(
    "--quantity",
    default="strain",
    show_default=True,
    help="strain, extension, exx, eyy, exy, e1, e2, u or v.",
)
@source_options
@click.option("--load", metavar="COLUMN:UNIT", help="Column of the load in the machine's record.")
@click.option("--time", metavar="COLUMN:UNIT", help="Column of the time in the machine's record.")
@record_options
@plot_options
def gauges(
    results: Path,
    gauges_file: Path | None,
    against: str,
    quantity: str,
    source: SourceOptions,
    load: str | None,
    time: str | None,
    record: RecordOptions,
    places: PlotOptions,
) -> None:
    """Draw gauges in one picture, against the number of the image, time or load.

    RESULTS is a result file of `dic correlate` or `dic process`. GAUGES is the TOML file of `dic gauges`. The
    bands are 95 % intervals. Lines have gaps where there is no reading.

    Exit status: 0 if every gauge is drawn at every image, 1 if there are gaps, 2 if nothing can be drawn.
    """
    from dic import plot_gauges

    settings = places.settings()
    require_places([results, gauges_file, *record.files], [places.output], force=places.force)
    series, _ = record.joined(source.read(results, gauges_file), load, time)
    gaps = plot_gauges(
        series, places.output, against=against, quantity=quantity, kinds=source.kinds, settings=settings
    )
    _end(places.output, gaps)


@plot.command()
@click.argument("results", type=_PATH)
@click.argument("gauges_file", type=_PATH, metavar="[GAUGES]", required=False)
@click.option("--quantity", default="eyy", show_default=True, help="u, v, exx, eyy or exy.")
@click.option(
    "--images",
    default="",
    metavar="NUMBERS",
    help="Numbers of the images, such as 1,4,8. Default: all, or 8 of a longer series.",
)
@source_options
@plot_options
def cuts(
    results: Path,
    gauges_file: Path | None,
    quantity: str,
    images: str,
    source: SourceOptions,
    places: PlotOptions,
) -> None:
    """Draw displacement or strain along line cuts, in one or several images.

    RESULTS is a result file of `dic correlate` or `dic process`. The TOML file GAUGES, or --gauge, declares
    at least one gauge of the kind cut. The bands are 95 % intervals. A place without a value leaves a gap.

    Exit status: 0 if every image is drawn, 1 if an image has no values, 2 if nothing can be drawn.
    """
    from dic import plot_cuts

    settings, numbers = places.settings(), _numbers(images)
    require_places([results, gauges_file], [places.output], force=places.force)
    series = source.read(results, gauges_file)
    gaps = plot_cuts(
        series, places.output, quantity=quantity, images=numbers, kinds=source.kinds, settings=settings
    )
    _end(places.output, gaps)


def _numbers(text: str) -> list[int]:
    from dic import GaugeError

    try:
        return [int(part) for part in text.split(",")] if text else []
    except ValueError as error:
        expected, remedy = "whole numbers with commas between them", "give for example --images 1,4,8"
        raise GaugeError("settings", "--images", expected, text, remedy) from error


def _end(picture: Path, gaps: Sequence[str]) -> None:
    """Print sentences about gaps in the picture, and end the command with its exit status."""
    for sentence in gaps:
        say(sentence)
    say(f"picture: {picture}")
    click.get_current_context().exit(1 if gaps else 0)
