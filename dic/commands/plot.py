"""The command `dic plot`: pictures of gauges, of line cuts, and animations, from a result file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import click

import dic
from dic.commands.options import Chosen, option, options, use
from dic.commands.plot_animation import animation
from dic.commands.record_options import LoadedRecord, loaded_record_options
from dic.commands.shared_options import declare_or_gauge, force
from dic.errors import GaugeError
from dic.pictures import PlotSettings, require_format
from dic.shell.console import say
from dic.shell.output_paths import PATH, require_places


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
def plot() -> None:
    """Draw gauges against time or load, line cuts, and animations of a field, from a result file.

    `dic correlate --maps` draws maps. Sizes are in millimetres on paper. Colour-blind people can distinguish
    the colours.
    """


plot.add_command(animation)


@options
class SourceOptions:
    """Options of `dic plot` that choose gauges and the kinds of their values."""

    texts: tuple[str, ...] = declare_or_gauge()
    camera: str | None = option(
        "--camera", help="Camera of a run. Default: all, if all gauges are in millimetres."
    )
    kinds: tuple[str, ...] = option(
        "--kind",
        multiple=True,
        help="raw, calibrated or corrected. May be repeated. Default: the best there is.",
    )

    def read(self, results: Path, gauges_file: Path | None) -> dic.gauges.GaugeSeries:
        """Read the chosen gauges in all images of the results."""
        series: dic.gauges.GaugeSeries = dic.measure_gauges(
            results, dic.read_gauges(gauges_file, self.texts), camera=self.camera
        )
        return series


@options
class PlotOutputs:
    """Options for the file of a picture."""

    output: Path = option("-o", "--output", required=True, help="Picture: .png, .pdf or .svg.")
    force: bool = force()

    def settings(self, size: Chosen[PlotSettings]) -> PlotSettings:
        """Return the size of the picture, after a check of the file."""
        require_format(self.output)
        return size.settings()


source_options = use("source", SourceOptions)
output_options = use("picture", PlotOutputs)
size_options = use("size", PlotSettings)


@plot.command()
@click.argument("results", type=PATH)
@click.argument("gauges_file", type=PATH, metavar="[GAUGES]", required=False)
@click.option(
    "--against",
    default="image",
    show_default=True,
    help="Axis: image (its number), time, load, or a channel of a run, such as channels.oven.",
)
@click.option(
    "--quantity",
    default="strain",
    show_default=True,
    help="strain, extension, exx, eyy, exy, e1, e2, u or v.",
)
@source_options
@loaded_record_options
@output_options
@size_options
def gauges(
    results: Path,
    gauges_file: Path | None,
    against: str,
    quantity: str,
    source: SourceOptions,
    record: LoadedRecord,
    picture: PlotOutputs,
    size: Chosen[PlotSettings],
) -> None:
    """Draw gauges in one picture, against the number of the image, time, load or a channel of a run.

    RESULTS is a result file of `dic correlate` or `dic process`. GAUGES is the TOML file of `dic gauges`. The
    bands are 95 % intervals. Lines have gaps where there is no reading.

    Exit status: 0 if every gauge is drawn at every image, 1 if there are gaps, 2 if nothing can be drawn.
    """
    settings = picture.settings(size)
    require_places([results, gauges_file, *record.files], [picture.output], force=picture.force)
    series, _ = record.joined_to(source.read(results, gauges_file))
    gaps = dic.gauges.plot_gauges(
        series,
        picture.output,
        against=against,
        quantity=quantity,
        kinds=source.kinds,
        settings=settings,
    )
    _end(picture.output, gaps)


@plot.command()
@click.argument("results", type=PATH)
@click.argument("gauges_file", type=PATH, metavar="[GAUGES]", required=False)
@click.option("--quantity", default="eyy", show_default=True, help="u, v, exx, eyy or exy.")
@click.option(
    "--images",
    default="",
    metavar="NUMBERS",
    help="Numbers of the images, such as 1,4,8. Default: all, or 8 of a longer series.",
)
@source_options
@output_options
@size_options
def cuts(
    results: Path,
    gauges_file: Path | None,
    quantity: str,
    images: str,
    source: SourceOptions,
    picture: PlotOutputs,
    size: Chosen[PlotSettings],
) -> None:
    """Draw displacement or strain along line cuts, in one or several images.

    RESULTS is a result file of `dic correlate` or `dic process`. The TOML file GAUGES, or --declare, declares
    at least one gauge of the kind cut. The bands are 95 % intervals. A place without a value leaves a gap.

    Exit status: 0 if every image is drawn, 1 if an image has no values, 2 if nothing can be drawn.
    """
    settings, numbers = picture.settings(size), _numbers(images)
    require_places([results, gauges_file], [picture.output], force=picture.force)
    series = source.read(results, gauges_file)
    gaps = dic.gauges.plot_cuts(
        series,
        picture.output,
        quantity=quantity,
        images=numbers,
        kinds=source.kinds,
        settings=settings,
    )
    _end(picture.output, gaps)


def _numbers(text: str) -> list[int]:
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
