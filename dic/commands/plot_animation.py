"""The command `dic plot animation`, which draws the maps of a series as a moving picture."""

from pathlib import Path

import click

import dic
from dic.commands.options import Chosen, use
from dic.commands.record_options import LoadedRecord, loaded_record_options
from dic.pictures import MapSettings
from dic.shell.console import fail, say
from dic.shell.output_paths import FORCE, PATH, require_places
from dic.shell.progress import progress


@click.command()
@click.argument("results", type=PATH)
@use(
    "frames",
    MapSettings,
    only=("quantities", "kind", "on", "axes", "limits", "colours", "width_mm", "dpi"),
    named={"quantities": "--quantity"},
    defaults={"quantities": ("eyy",), "width_mm": 120.0},
)
@loaded_record_options
@click.option("--frames-per-s", default=5.0, show_default=True, help="Number of images in a second.")
@click.option("--camera", help="Camera of a run; needed if the run has several.")
@click.option("-o", "--output", type=PATH, required=True, help="Animation: .gif or .mp4.")
@FORCE
def animation(
    results: Path,
    frames: Chosen[MapSettings],
    record: LoadedRecord,
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
    settings = frames.settings()
    require_places([results, *record.files], [output], force=force)
    known = []
    if record.record_file is None:
        record.require_none("--record beside it")
    else:
        series, _ = record.joined_to(dic.measure_gauges(results, ()))
        known = [image.known for image in series.images]
    with progress("drawing") as bar:
        done = dic.write_animation(
            results,
            output,
            settings=settings,
            frames_per_s=frames_per_s,
            camera=camera,
            known=known,
            on_image=bar.advance_of,
        )
    for sentence in done.failures:
        fail(f"shown without values: {sentence}")
    say(f"animation: {output}, {done.frames} images")
    click.get_current_context().exit(1 if done.failures else 0)
