"""The command `rig watch`."""

from pathlib import Path

import click

from dic.shell.console import say
from dic.shell.output_paths import FORCE, require_places
from rig.commands.output import JSON, finish


@click.command()
@click.argument("target", metavar="RUN")
@click.option("--once", is_flag=True, help="Print what the run tells now, and exit.")
@JSON
@FORCE
def watch(target: str, once: bool, json_path: Path | None, force: bool) -> None:
    """Show a run that another program executes: RUN is its file, its folder, or http://127.0.0.1:PORT.

    Only the heartbeat beside the run file or the HTTP interface of the run is read, so the run is never
    touched. Ctrl-C ends the watching and not the run. The exit status is 1 if the run gives no news any more
    or was not completed.
    """
    from dic.shell.bottom_lines import bottom_lines
    from drivers.clock import SystemClock
    from rig.commands.news_sources import find_source
    from rig.commands.watching import REFRESHES_PER_S, Watch

    clock = SystemClock()
    require_places([] if "://" in target else [Path(target)], [json_path], force=force)
    watched = Watch(find_source(target, clock), clock, say)
    left = False
    if not (once or watched.verdict.over):
        live = bottom_lines(watched.draw, REFRESHES_PER_S)
        try:
            if live is None:
                watched.follow(drawn=False)
            else:
                with live:
                    watched.follow(drawn=True)
        except KeyboardInterrupt:
            left = True
    lines = ["left; the run is not touched"] if left else watched.lines()
    finish(lines, watched.table(), json_path, good=watched.verdict.good)
