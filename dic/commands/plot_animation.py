"""The command `dic plot animation`, which draws the maps of a series as a moving picture."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from dic.commands.map_options import limits_of
from dic.commands.option_groups import option_group
from dic.commands.record_options import RecordOptions, record_options
from dic.shell.console import fail, say
from dic.shell.output_paths import FORCE, require_places

if TYPE_CHECKING:
    from dic import MapSettings

_PATH = click.Path(path_type=Path)


@dataclass(frozen=True)
class FrameOptions:
    """Options for the maps in the frames; they mean the same as the `--map-…` options of `dic correlate`."""

    quantity: str
    kind: str
    on: str
    axes: str
    limits: tuple[str, ...]
    colours: str
    width_mm: float
    dpi: int

    def settings(self) -> "MapSettings":
        """Return the options as `MapSettings`."""
        from dic import MapSettings

        return MapSettings(
            quantities=tuple(name.strip() for name in self.quantity.split(",")),
            kind=self.kind,
            on=self.on,
            axes=self.axes,
            limits=limits_of(self.limits, "--limits"),
            colours=self.colours,
            width_mm=self.width_mm,
            dpi=self.dpi,
        )


@click.command()
@click.argument("results", type=_PATH)
@option_group(
    "frames",
    FrameOptions,
    click.option(
        "--quantity", default="eyy", show_default=True, help="u, v, exx, eyy, exy, or several, such as u,eyy."
    ),
    click.option("--kind", default="best", show_default=True, help="raw, calibrated, corrected, or best."),
    click.option(
        "--on",
        default="reference",
        show_default=True,
        help="Image under the maps: reference, or deformed (read from the image files or the run file).",
    ),
    click.option("--axes", default="auto", show_default=True, help="mm, px, off, or auto."),
    click.option(
        "--limits",
        multiple=True,
        metavar="QUANTITY=LOW,HIGH",
        help="Ends of a quantity's scale, in the unit of its map, such as eyy=0,2000. May be repeated.",
    ),
    click.option(
        "--colours",
        default="viridis",
        show_default=True,
        help="Range of colours: viridis, cividis, inferno, grey, or diverging (white at zero).",
    ),
    click.option("--width-mm", default=120.0, show_default=True, help="Width of the picture."),
    click.option("--dpi", default=150, show_default=True, help="Resolution, points per inch."),
)
@click.option("--load", metavar="COLUMN:UNIT", help="Column of the load in the machine's record.")
@click.option("--time", metavar="COLUMN:UNIT", help="Column of the time in the machine's record.")
@record_options
@click.option("--frames-per-s", default=5.0, show_default=True, help="Number of images in a second.")
@click.option("--camera", help="Camera of a run; needed if the run has several.")
@click.option("-o", "--output", type=_PATH, required=True, help="Animation: .gif or .mp4.")
@FORCE
def animation(
    results: Path,
    frames: FrameOptions,
    load: str | None,
    time: str | None,
    record: RecordOptions,
    frames_per_s: float,
    camera: str | None,
    output: Path,
    force: bool,
) -> None:
    """Draw the maps of all images as an animation on one scale, with the state of each image in the title.

    RESULTS is a result file of `dic correlate` or `dic process`. A GIF file plays everywhere; an MP4 file is
    smaller. Memory does not grow with the number of images. With --record, the titles contain the load of a
    testing machine.

    Exit status: 0 if every image is shown with values, 1 if an image could not be measured, 2 if nothing can
    be drawn.
    """
    from dic import measure_gauges, write_animation
    from dic.shell.progress import progress

    settings = frames.settings()
    require_places([results, *record.files], [output], force=force)
    known = []
    if record.record_file is None:
        record.require_none("--record beside it", load=load, time=time)
    else:
        series, _ = record.joined(measure_gauges(results, ()), load, time)
        known = [image.known for image in series.images]
    with progress("drawing") as bar:

        def count(total: int) -> None:
            bar.expect(total)
            bar.advance()

        done = write_animation(
            results,
            output,
            settings=settings,
            frames_per_s=frames_per_s,
            camera=camera,
            known=known,
            on_image=count,
        )
    for sentence in done.failures:
        fail(f"shown without values: {sentence}")
    say(f"animation: {output}, {done.frames} images")
    click.get_current_context().exit(1 if done.failures else 0)
