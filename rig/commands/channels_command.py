"""The command `rig channels`."""

from contextlib import suppress
from pathlib import Path

import click

from dic.shell.bottom_lines import bottom_lines
from dic.shell.console import say
from dic.shell.output_paths import FORCE, require_places
from rig.commands.output import JSON, PATH, NumberRange, finish

_SIMULATED_S = 10.0
_REFRESHES_PER_S = 4.0
_SLICE_S = 0.25


@click.command()
@click.argument("rig_path", metavar="RIG", type=PATH)
@click.option(
    "--seconds",
    type=NumberRange(0.5, 30 * 24 * 3600.0),
    help="Read for this time. Default: until Ctrl-C; 10 s in simulated time.",
)
@click.option("--csv", "table", type=PATH, help="Write all samples to this file as CSV.")
@JSON
@FORCE
def channels(
    rig_path: Path, seconds: float | None, table: Path | None, json_path: Path | None, force: bool
) -> None:
    """Show the present values of all channels of RIG, without a run. No other device is opened.

    For each signal: value, unit, noise of the last two seconds, range, rate, lost samples, and the standard
    deviation of the samples' times. On a terminal the values change in place; the last ones are printed.
    """
    from drivers.clock import VirtualClock
    from rig import open_rig, read_rig
    from rig.commands.watch_channels import ChannelWatch, lines_of, only_channels

    require_places([rig_path], [table, json_path], force=force)
    with open_rig(only_channels(read_rig(rig_path))) as rig:
        if seconds is None and isinstance(rig.clock, VirtualClock):
            seconds = _SIMULATED_S
        watch = ChannelWatch(rig, table)
        live = bottom_lines(
            lambda: "\n".join([*lines_of(watch.now(), whole=False), "Ctrl-C: end"]), _REFRESHES_PER_S
        )
        if seconds is None:
            say("rig: the channels are read until Ctrl-C", err=True)
        with watch.reading():
            if live is not None:
                live.start()
            try:
                with suppress(KeyboardInterrupt):
                    if seconds is not None:
                        watch.wait(seconds)
                    while seconds is None:
                        watch.wait(_SLICE_S)
            finally:
                if live is not None:
                    live.stop()
        found = watch.now()
    lines = lines_of(found)
    if table is not None:
        lines.append(f"{table}: {sum({each.device: each.samples for each in found}.values())} samples")
    content = {"channels": [each.as_dict() for each in found]}
    finish(lines, content, json_path, good=all(each.is_good for each in found))
