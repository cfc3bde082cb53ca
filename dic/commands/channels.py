"""The command `dic channels`, which shows the measured channels of a run and writes their samples as CSV."""

import json
from pathlib import Path

import click

import dic
from dic.files import write_text
from dic.shell.console import say
from dic.shell.output_paths import FORCE, PATH, require_places


@click.command()
@click.argument("run", type=PATH)
@click.option("-o", "--output", type=PATH, help="Table of all samples as CSV.")
@click.option(
    "--signal", "signals", multiple=True, help="Write only this signal. Repeatable. Default: all signals."
)
@click.option(
    "--decimal-comma",
    is_flag=True,
    help="Write decimal commas, and semicolons between the cells.",
)
@click.option("--json", "json_file", type=PATH, help="JSON file of what is printed.")
@FORCE
def channels(
    run: Path,
    output: Path | None,
    signals: tuple[str, ...],
    decimal_comma: bool,
    json_file: Path | None,
    force: bool,
) -> None:
    """Show the measured channels of RUN, a run file, and write their samples as a table.

    Each line of the table has a time, its standard deviation, and the values that the quantities had then:
    the declared delay of each signal is subtracted. Signals that were measured at other times have empty
    cells.
    """
    require_places([run], [output, json_file], force=force)
    if output is None and (signals or decimal_comma):
        raise click.UsageError("give --signal and --decimal-comma only with -o")
    found = dic.derived.channel_summaries(run)
    for each in found:
        say(
            f"{each.signal} [{each.unit}] of {each.device}: {each.samples} samples, {each.lost} lost, "
            f"{each.rate_hz:.4g} per s, {each.least:.6g} to {each.greatest:.6g}, "
            f"delay {each.delay_s:g} ± {each.delay_std_s:g} s"
        )
    if not found:
        say("the run has no measured channels")
    lines = None
    if output is not None:
        lines = dic.derived.write_channels(run, output, signals=signals, decimal_comma=decimal_comma)
        say(f"{output}: {lines} lines")
    if json_file is not None:
        table = {"channels": [each.as_dict() for each in found], "lines": lines}
        write_text(json_file, json.dumps(table, indent=1, allow_nan=False) + "\n")
