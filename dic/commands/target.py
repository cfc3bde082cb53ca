"""The command `dic target`, which draws a calibration target for printing."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from dic.commands.target_options import COUNT
from dic.errors import CalibrationError
from dic.shell.console import say
from dic.shell.output_paths import FORCE, require_places

if TYPE_CHECKING:
    from dic import Target

_FILE = click.Path(path_type=Path)
_KINDS = ("lines", "checkerboard", "charuco", "dots", "asymmetric-dots")


@click.command()
@click.argument("kind", type=click.Choice(_KINDS))
@click.option(
    "--count",
    type=COUNT,
    required=True,
    help="Numbers of lines, squares or dots along X and Y, such as 21x21; "
    "for asymmetric-dots, dots in a row and rows.",
)
@click.option("--pitch-mm", type=float, required=True, help="Spacing of lines, corners, or dots in a row.")
@click.option("--marker-mm", type=float, help="Side of a ChArUco board's markers.  [default: 0.75 pitches]")
@click.option(
    "--dictionary",
    default="DICT_5X5_100",
    show_default=True,
    help="OpenCV's name for the dictionary of a ChArUco board's markers.",
)
@click.option("-o", "--output", type=_FILE, required=True, help="File to write: .pdf, .svg or .png.")
@click.option("--dpi", default=600.0, show_default=True, help="Pixels per inch of a PNG file.")
@FORCE
def target(
    kind: str,
    count: tuple[int, int],
    pitch_mm: float,
    marker_mm: float | None,
    dictionary: str,
    output: Path,
    dpi: float,
    force: bool,
) -> None:
    """Draw a calibration target of a KIND to print at its true size.

    KIND is lines, checkerboard, charuco, dots, or asymmetric-dots (every second row is shifted by half a
    pitch, as in OpenCV's asymmetric grid of circles).

    The sheet has two rulers, by which you check that the printer did not change the size. The command prints
    the options with which `dic calibrate` finds the target.
    """
    from dic import draw_target

    if marker_mm is not None and kind != "charuco":
        raise CalibrationError(
            "settings", "--marker-mm", "a target of the KIND charuco", kind, "leave out --marker-mm"
        )
    marker = 0.75 * pitch_mm if marker_mm is None else marker_mm
    drawn, options = _described(kind, count, pitch_mm, marker, dictionary)
    require_places([], [output], force=force)
    width_mm, height_mm = draw_target(drawn, output, dpi)
    say(f"target: {output}, {width_mm:g} × {height_mm:g} mm")
    say("print it without scaling, and measure both rulers")
    say(f"to find it: dic calibrate IMAGE {options}")


def _described(
    kind: str, count: tuple[int, int], pitch_mm: float, marker_mm: float, dictionary: str
) -> tuple["Target", str]:
    """Return the target, and the options of `dic calibrate` that describe it."""
    from dic import AsymmetricDotTarget, CharucoTarget, CheckerboardTarget, DotTarget, LineGridTarget

    numbers, pitch = f"{count[0]}x{count[1]}", f"--pitch-mm {pitch_mm:g}"
    if kind == "lines":
        return LineGridTarget(count, pitch_mm), f"--lines {numbers} {pitch}"
    if kind == "dots":
        return DotTarget(count, pitch_mm), f"--dots {numbers} {pitch}"
    if kind == "asymmetric-dots":
        return AsymmetricDotTarget(count, pitch_mm), f"--asymmetric-dots {numbers} {pitch}"
    if kind == "checkerboard":
        return CheckerboardTarget(count, pitch_mm), f"--squares {numbers} {pitch}"
    options = f"--squares {numbers} {pitch} --marker-mm {marker_mm:g} --dictionary {dictionary}"
    return CharucoTarget(count, pitch_mm, marker_mm, dictionary), options
