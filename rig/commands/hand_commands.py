"""The commands `rig status`, `rig hold`, `rig unload` and `rig jog`."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dic.shell.console import say
from dic.shell.output_paths import FORCE, require_places
from rig.commands.output import JSON, PATH, NumberRange, finish

if TYPE_CHECKING:
    from rig.commands.hand_plan import Wish
    from rig.engine.manual import Moved

_RIG = click.argument("rig_path", metavar="RIG", type=PATH)
_YES = click.option("--yes", is_flag=True, help="Move without a question, for scripts.")
_TRAVEL = click.option(
    "--travel-max-mm",
    type=NumberRange(0.0, 1000.0, min_open=True),
    help="Stop if the crosshead has moved this far and the load is not reached. Default: the travel that is "
    "plausible for the load.",
)


@click.command()
@_RIG
@JSON
@FORCE
def status(rig_path: Path, json_path: Path | None, force: bool) -> None:
    """Print the present load, displacement and angle, and which program uses the rig. Nothing moves."""
    from rig.commands.at_rest import at_rest_dict, at_rest_line
    from rig.commands.by_hand import see

    require_places([rig_path], [json_path], force=force)
    seen = see(rig_path)
    lines = [f"{seen.in_use}: its devices are not read."] if seen.in_use else [at_rest_line(seen.at_rest)]
    for sentence in seen.at_rest.silent.values():
        say(f"rig: {sentence}", err=True)
    table = {**at_rest_dict(seen.at_rest), "in_use": seen.in_use}
    finish(lines, table, json_path, good=not (seen.in_use or seen.at_rest.silent))


@click.command()
@_RIG
@click.option("--yes", is_flag=True, help="Has no effect: a stop is never delayed by a question.")
@JSON
@FORCE
def hold(rig_path: Path, yes: bool, json_path: Path | None, force: bool) -> None:
    """Hold the load frame and stop the stage at once, without a question.

    A run that has the machine is asked to end, which holds the load frame and stops the stage.
    """
    from rig.commands import by_hand

    require_places([rig_path], [json_path], force=force)
    _report(by_hand.hold(rig_path, lambda line: say(f"rig: {line}", err=True)), json_path)


@click.command()
@_RIG
@click.option("--rate", type=float, help="Rate in N/s. Default: full load in 100 s.")
@_TRAVEL
@_YES
@JSON
@FORCE
def unload(
    rig_path: Path,
    rate: float | None,
    travel_max_mm: float | None,
    yes: bool,
    json_path: Path | None,
    force: bool,
) -> None:
    """Take the load off the specimen slowly, down to 0 N, then hold. Ctrl-C holds at once."""
    from rig.commands.hand_plan import Wish

    require_places([rig_path], [json_path], force=force)
    _move(rig_path, Wish("load", 0.0, rate=rate, travel_max_mm=travel_max_mm), yes, "unload", json_path)


@click.command()
@_RIG
@click.option("--load-n", type=float, help="Go to this load, in N.")
@click.option("--displacement-mm", type=float, help="Go to this displacement, in mm.")
@click.option("--angle-deg", type=float, help="Turn to this angle, in degrees.")
@click.option("--relative", is_flag=True, help="Count the target from the present reading.")
@click.option("--rate", type=float, help="Rate in N/s, or speed in mm/s. Default: slow.")
@_TRAVEL
@click.option(
    "--free",
    is_flag=True,
    help="No specimen is in the grips, so the load need not follow --displacement-mm. The motion ends if the "
    "load changes.",
)
@_YES
@JSON
@FORCE
def jog(
    rig_path: Path,
    load_n: float | None,
    displacement_mm: float | None,
    angle_deg: float | None,
    json_path: Path | None,
    **how: Any,
) -> None:
    """Move one axis within the limits of RIG, then hold. Ctrl-C stops at once.

    Give exactly one of --load-n, --displacement-mm and --angle-deg.
    """
    from rig.commands.hand_plan import Wish

    wanted = {"load": load_n, "displacement": displacement_mm, "angle": angle_deg}
    given = [(axis, value) for axis, value in wanted.items() if value is not None]
    if len(given) != 1:
        raise click.UsageError("give exactly one of --load-n, --displacement-mm and --angle-deg")
    require_places([rig_path], [json_path], force=how["force"])
    (axis, value) = given[0]
    if how["free"] and axis != "displacement":
        raise click.UsageError("give --free only with --displacement-mm")
    if how["rate"] is not None and axis == "angle":
        raise click.UsageError("give --rate only with --load-n or --displacement-mm")
    if how["travel_max_mm"] is not None and axis != "load":
        raise click.UsageError("give --travel-max-mm only with --load-n")
    wish = Wish(axis, value, how["relative"], how["rate"], how["travel_max_mm"], how["free"])
    _move(rig_path, wish, how["yes"], "move", json_path)


def _move(rig_path: Path, wish: "Wish", yes: bool, word: str, json_path: Path | None) -> None:
    from rig.commands.by_hand import confirmation, move
    from rig.commands.progress import hand_screen

    with hand_screen() as screen, confirmation(yes, word) as confirm:
        moved = move(rig_path, wish, screen.after(confirm), screen.on_reading)
    _report(moved, json_path)


def _report(moved: "Moved", json_path: Path | None) -> None:
    from rig.commands.at_rest import at_rest_dict, at_rest_line

    if moved.reason:
        say(f"rig: {moved.reason}", err=True)
    table = {
        "status": moved.status,
        "reason": moved.reason,
        "unsafe": list(moved.unsafe),
        "at_end": at_rest_dict(moved.at_end),
    }
    lines = [f"{moved.status}: {at_rest_line(moved.at_end)}"]
    done = not moved.unsafe and (moved.begun or moved.status == "completed")
    finish(lines, table, json_path, good=moved.status == "completed", done=done)
