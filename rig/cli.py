"""The command `rig`. Heavy imports stand inside the commands, so that ``--help`` answers at once."""

import json
import sys
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dic.errors import MeasurementError
from dic.shell.console import run as run_command
from dic.shell.console import say
from dic.shell.output_paths import require_places
from drivers.errors import ConfigurationError, DeviceError
from rig import RigError

if TYPE_CHECKING:
    from rig import Outcome, StepRecord

NOT_GOOD = 1

_PATH = click.Path(path_type=Path)
_JSON = click.option("--json", "json_path", type=_PATH, help="Also write what is printed as JSON.")


def main() -> None:
    """Run the command line; a known error prints one sentence on stderr and exits with status 2."""
    run_command(cli, (RigError, DeviceError, ConfigurationError, MeasurementError), "rig")


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="offaxis")
def cli() -> None:
    """Run experiments: plan them, look at the rig, run them, verify the run file.

    Exit status: 0 done, 1 done but not good, 2 could not be done.
    """


@cli.command()
@click.argument("protocol", type=_PATH)
@click.option(
    "--rig",
    "rig_path",
    type=_PATH,
    help="The rig file: also plan the size of the images, and check the rig's limits.",
)
@_JSON
def plan(protocol: Path, rig_path: Path | None, json_path: Path | None) -> None:
    """Print every step of PROTOCOL, duration, bytes and worst load. Nothing moves."""
    from rig import plan_protocol
    from rig.commands.plan import plan_dict, plan_lines

    require_places([protocol, rig_path], [json_path])
    made = plan_protocol(protocol, rig_path)
    _finish(plan_lines(made), plan_dict(made), json_path, good=not made.objections)


@cli.command()
@click.argument("protocol", type=_PATH)
@click.option("--rig", "rig_path", type=_PATH, required=True, help="The rig file.")
@click.option("-o", "--output", type=_PATH, help="The run file; PROTOCOL's name with .h5 by default.")
@_JSON
def run(protocol: Path, rig_path: Path, output: Path | None, json_path: Path | None) -> None:
    """Run PROTOCOL and write one run file. Ctrl-C holds the load frame, stops the stage and ends the run."""
    from rig import run_protocol
    from rig.commands.progress import run_progress

    run_path = output or Path(f"{protocol.stem}.h5")
    require_places([protocol, rig_path, run_path], [json_path])
    records: list[StepRecord] = []
    on_step = (records.append, lambda record: say(_step_line(record)))
    with run_progress() as on_status:
        outcome = run_protocol(protocol, rig_path, run_path, on_status=[on_status], on_step=on_step)
    lines = [f"{outcome.status}: {outcome.steps_done} steps in {run_path}"]
    for sentence in filter(None, (outcome.reason, *outcome.lost_listeners)):
        say(f"rig: {sentence}", err=True)
    _finish(lines, _run_dict(run_path, outcome, records), json_path, good=outcome.status == "completed")


@cli.command()
@click.argument("rig_path", metavar="RIG", type=_PATH)
@_JSON
def check(rig_path: Path, json_path: Path | None) -> None:
    """Open the devices of RIG, read identity, state and limits, take one image each. Nothing moves."""
    from rig import open_rig, read_rig
    from rig.commands.check import check_rig

    require_places([rig_path], [json_path])
    with open_rig(read_rig(rig_path)) as rig:
        found = check_rig(rig)
    lines = found.lines + [f"not good: {problem}" for problem in found.problems]
    table = {"devices": found.devices, "problems": found.problems}
    _finish(lines, table, json_path, good=not found.problems)


@cli.command()
@click.option("--port", "ports", multiple=True, help="Also search this serial port; may be repeated.")
@click.option(
    "--modbus", "hosts", multiple=True, metavar="HOST[:PORT]", help="Also search this Modbus address."
)
@click.option("--no-probe", is_flag=True, help="Send nothing to any device.")
@click.option("-o", "--output", type=_PATH, help="Write a rig file to start from.")
@_JSON
def devices(
    ports: tuple[str, ...],
    hosts: tuple[str, ...],
    no_probe: bool,
    output: Path | None,
    json_path: Path | None,
) -> None:
    """List cameras, serial ports and the devices that answer. Nothing moves and no setting is changed."""
    from rig.commands.device_search import search
    from rig.commands.devices import lines, table, write_rig_file

    require_places([], [output, json_path])
    found = search(list(ports), list(hosts), ask=not no_probe)
    if output is not None:
        write_rig_file(found, output)
    _finish(lines(found), table(found), json_path, good=True)


@cli.command()
@click.argument("run_file", metavar="RUN", type=_PATH)
@_JSON
def verify(run_file: Path, json_path: Path | None) -> None:
    """Check every image of a run file against its checksum and list what is missing; cut-off runs too."""
    from dataclasses import asdict

    from rig import verify_run

    require_places([run_file], [json_path])
    found = verify_run(run_file)
    lines = [f"{found.path}: {found.status}, {found.steps} of {found.planned} planned steps"]
    lines += [
        f"{name}: {camera.valid} images, {camera.in_steps} in finished steps, {len(camera.damaged)} damaged"
        for name, camera in found.cameras.items()
    ]
    lines += [f"not good: {problem}" for problem in found.problems]
    _finish(lines, asdict(found) | {"path": str(found.path)}, json_path, good=not found.problems)


@cli.command()
@click.argument("rig_path", metavar="[RIG]", type=_PATH, required=False)
@click.option("-o", "--output", type=_PATH, help="Write a rig file that uses the simulated devices.")
@click.option("--log", type=_PATH, help="Write the true state of the simulation, as lines of JSON.")
@click.option(
    "--period-s",
    type=click.FloatRange(0.01, 3600),
    default=0.1,
    show_default=True,
    help="Time between two samples in the log.",
)
@click.option(
    "--fault", "faults", multiple=True, help="Start with this fault switched on, such as stage.drop:2."
)
@click.option(
    "--at",
    "places",
    multiple=True,
    metavar="NAME=PLACE",
    help="The place of a server: a TCP port, such as load_frame=5020, or the name of a terminal, such as "
    "stage=/tmp/stage. May be repeated; other servers choose a free place.",
)
@click.option("--list-faults", is_flag=True, help="Print all faults and end.")
@_JSON
def simulate(
    rig_path: Path | None,
    output: Path | None,
    log: Path | None,
    period_s: float,
    faults: tuple[str, ...],
    places: tuple[str, ...],
    list_faults: bool,
    json_path: Path | None,
) -> None:
    """Start the virtual rig as servers for other programs, in real time, until Ctrl-C.

    RIG is a rig file in which every device is simulated. Without RIG there are a stage, a load frame and
    two cameras. Type help while the simulation runs.
    """
    from rig.commands.simulate import find_simulator, run, signals_noted, start

    if list_faults:
        _finish(find_simulator().list_faults(), {}, None, good=True)
        return
    require_places([rig_path], [output, log, json_path])
    with signals_noted() as ending, closing(start(rig_path, log, faults, places)) as simulation:
        if output is not None:
            _write(output, simulation.rig_file(), "-o")
        addresses = dict(simulation.addresses)
        lines = [f"{name}: {address}" for name, address in addresses.items()]
        _finish(lines, addresses, json_path, good=True)
        run(simulation, ending, period_s, say)


@cli.command()
@click.option("-o", "--output", type=_PATH, default=Path("demo"), show_default=True, help="Folder.")
def demo(output: Path) -> None:
    """Run both of the paper's experiments on a virtual rig, measure them and write the report."""
    from rig.commands.demo import run_demo

    made = run_demo(output, say)
    say(f"open {made.report.resolve()}")


def _finish(lines: list[str], table: dict[str, Any], json_path: Path | None, *, good: bool) -> None:
    for line in lines:
        say(line)
    if json_path is not None:
        _write(json_path, json.dumps(table, indent=2, allow_nan=False) + "\n", "--json")
    if not good:
        sys.exit(NOT_GOOD)


def _write(path: Path, text: str, option: str) -> None:
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise RigError(
            str(path),
            "a file that can be written",
            error.strerror or str(error),
            f"name another file with {option}",
        ) from error


def _step_line(record: "StepRecord") -> str:
    images = ", ".join(f"{count} {name}" for name, (_, count) in record.frames.items())
    shown = ", ".join(f"{value:.6g} {unit}" for unit, value in record.reading.by_unit().items())
    return f"{record.step}: settled at {shown}; images: {images}"


def _run_dict(run_path: Path, outcome: "Outcome", records: "list[StepRecord]") -> dict[str, Any]:
    steps = [
        {
            "index": record.step.index,
            "kind": record.step.kind,
            "target": record.step.target if record.step.target == record.step.target else None,
            "load_n": record.reading.by_unit().get("N"),
            "displacement_mm": record.reading.by_unit().get("mm"),
            "angle_deg": record.reading.by_unit().get("deg"),
            "time_s": record.reading.time_s,
            "images": {name: count for name, (_, count) in record.frames.items()},
        }
        for record in records
    ]
    return {
        "run_file": str(run_path),
        "status": outcome.status,
        "reason": outcome.reason,
        "unsafe": list(outcome.unsafe),
        "steps": steps,
    }
