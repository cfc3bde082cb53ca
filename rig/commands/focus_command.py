"""The command `rig focus`."""

from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dic.shell.console import say
from dic.shell.output_paths import FORCE, require_places
from rig import RigError
from rig.commands.output import JSON, PATH, NumberRange, finish

if TYPE_CHECKING:
    from rig import RigFile
    from rig.commands.focusing import Focus


@click.command()
@click.argument("rig_path", metavar="RIG", type=PATH)
@click.option("--camera", "cameras", multiple=True, metavar="NAME", help="Only this camera. Repeatable.")
@click.option(
    "--grid", "protocol", type=PATH, metavar="PROTOCOL", help="Look for the grid of this protocol, too."
)
@click.option("--seconds", type=NumberRange(0.0, 86400.0, min_open=True), help="End after this time.")
@click.option("--once", is_flag=True, help="Take one image with each camera, print its figures, and exit.")
@click.option("-o", "--output", type=PATH, help="At the end, keep each camera's image here, as NAME.png.")
@JSON
@FORCE
def focus(
    rig_path: Path,
    cameras: tuple[str, ...],
    protocol: Path | None,
    output: Path | None,
    json_path: Path | None,
    **how: Any,
) -> None:
    """Stream focus, light, speckles and the residual of the grid while you set up the cameras of RIG.

    Only the cameras are opened, so nothing moves. Figures that take long are computed beside the images, and
    their age is told. On a terminal, the key s keeps images, r forgets the best sharpness, q ends.
    """
    from drivers.clock import SystemClock
    from rig import open_rig, read_protocol, read_rig
    from rig.commands.check import keep_in
    from rig.commands.focus_figures import target_of
    from rig.commands.focus_stream import FocusStream
    from rig.commands.focus_view import problems
    from rig.commands.focusing import Focus

    if how["once"] and how["seconds"] is not None:
        raise click.UsageError("give --seconds only without --once")
    rig_file = only_cameras(read_rig(rig_path), cameras)
    target = None if protocol is None else target_of(read_protocol(protocol).grid)
    pictures = [] if output is None else [output / f"{name}.png" for name in rig_file.cameras]
    if output is not None:
        output.mkdir(parents=True, exist_ok=True)
    require_places([rig_path, protocol], [*pictures, json_path], force=how["force"])
    failed: dict[str, str] = {}
    with open_rig(rig_file, failed=failed) as rig:
        focused = Focus(rig, target)
        if how["once"]:
            focused.once()
        else:
            keep = None if output is None else keep_in(output)
            with suppress(KeyboardInterrupt):
                FocusStream(focused, SystemClock(), say, keep, output).follow(how["seconds"])
        if output is not None:
            focused.keep(keep_in(output))
    for sentence in failed.values():
        say(f"rig: {sentence}", err=True)
    finish(
        _lines(focused),
        {
            "cameras": {each.camera_name: each.table() for each in focused.cameras},
            "problems": problems(focused),
            "failed": failed,
        },
        json_path,
        good=not problems(focused),
        done=not failed and all(each.newest is not None for each in focused.cameras),
    )


def only_cameras(rig_file: "RigFile", names: tuple[str, ...]) -> "RigFile":
    """Return the rig with some of its cameras, all if no name is given, and without any other device.

    Raise `RigError` if it has no camera, or none of a name.
    """
    known = ", ".join(rig_file.cameras) or "none"
    unknown = [name for name in names if name not in rig_file.cameras]
    if unknown or not rig_file.cameras:
        got = repr(unknown[0]) if unknown else "none"
        raise RigError(str(rig_file.path), f"cameras of the rig ({known})", got, "correct the name")
    kept = {name: each for name, each in rig_file.cameras.items() if not names or name in names}
    nothing: dict[str, Any] = {"channels": {}, "interlocks": {}, "triggers": {}, "measured_load": None}
    return replace(rig_file, cameras=kept, stage=None, load_frame=None, **nothing)


def _lines(focused: "Focus") -> list[str]:
    from rig.commands.focus_view import camera_lines, problems

    lines = [f"{each.camera_name}: {line}" for each in focused.cameras for line in camera_lines(each)]
    return [*lines, *(f"not good: {problem}" for problem in problems(focused))]
