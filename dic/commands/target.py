"""The command `dic target`, which draws a calibration target for printing."""

from dataclasses import make_dataclass
from pathlib import Path
from typing import Any

import click

import dic
from dic.commands.options import telling, use
from dic.commands.target_options import COUNT, PITCH, further_fields
from dic.errors import CalibrationError
from dic.settings import either
from dic.shell.console import say
from dic.shell.output_paths import FORCE, PATH, require_places
from dic.targets import TARGETS

_KINDS = [f"{kind.name} ({kind.about})" if kind.about else kind.name for kind in TARGETS.values()]
_COUNTED = either(dict.fromkeys(kind.counted for kind in TARGETS.values()))
_NOTES = "".join(f"; for {kind.name}, {kind.about_counts}" for kind in TARGETS.values() if kind.about_counts)
_Further = make_dataclass("_Further", further_fields(drawn=True), frozen=True)


@click.command()
@click.argument("kind", type=click.Choice(list(TARGETS)))
@click.option(
    "--count",
    type=COUNT,
    required=True,
    help=f"Numbers of {_COUNTED} along X and Y, such as 21x21{_NOTES}.",
)
@click.option("--pitch-mm", type=float, required=True, help=PITCH)
@use("further", _Further)
@click.option("-o", "--output", type=PATH, required=True, help="File to write: .pdf, .svg or .png.")
@click.option("--dpi", default=600.0, show_default=True, help="Pixels per inch of a PNG file.")
@FORCE
@telling(kinds=f"{', '.join(_KINDS[:-1])}, or {_KINDS[-1]}")
def target(
    kind: str,
    count: tuple[int, int],
    pitch_mm: float,
    further: Any,
    output: Path,
    dpi: float,
    force: bool,
) -> None:
    """Draw a calibration target of a KIND to print at its true size.

    KIND is {kinds}.

    The sheet has two rulers, by which you check that the printer did not change the size. The command prints
    the options with which `dic calibrate` finds the target.
    """
    chosen, values = TARGETS[kind], {"pitch_mm": pitch_mm, **vars(further)}
    for name, value in vars(further).items():
        able = [each.name for each in TARGETS.values() if name in each.needed()]
        if able and value is not None and kind not in able:
            option, expected = f"--{name.replace('_', '-')}", f"a target of the KIND {either(able)}"
            raise CalibrationError("settings", option, expected, kind, f"leave out {option}")
    drawn = chosen.of(count, values)
    require_places([], [output], force=force)
    width_mm, height_mm = dic.targets.draw_target(drawn, output, dpi)
    say(f"target: {output}, {width_mm:g} × {height_mm:g} mm")
    say("print it without scaling, and measure both rulers")
    say(f"to find it: dic calibrate IMAGE {drawn.options}")
