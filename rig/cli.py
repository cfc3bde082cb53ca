"""The command `rig`. Slow imports are inside the functions of the commands, so that ``--help`` is quick."""

from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

import click

from dic.errors import MeasurementError
from dic.shell.console import run as run_command, say
from dic.shell.output_paths import FORCE, require_places
from drivers.errors import ConfigurationError, DeviceError
from rig import RigError
from rig.commands.channels_command import channels
from rig.commands.focus_command import focus
from rig.commands.hand_commands import hold, jog, status, unload
from rig.commands.output import JSON as _JSON, PATH as _PATH, NumberRange, finish as _finish, write as _write
from rig.commands.queue_command import queue
from rig.commands.watch_command import watch
from rig.threads import (
    device_threads,
    drivers_exit_by_exception,
    last_resort,
    leave,
    never_released,
)


def main() -> None:
    """Run the command line. For a known error, print one sentence on stderr and exit with status 2."""
    before, kept = device_threads(), never_released()
    try:
        with last_resort(), drivers_exit_by_exception():
            run_command(cli, (RigError, DeviceError, ConfigurationError, MeasurementError), "rig")
    except SystemExit as ended:
        leave(int(ended.code or 0), before, kept)
        raise


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="offaxis")
def cli() -> None:
    """Check a rig, plan and run experiments, and verify run files.

    Exit status: 0 for success, 1 for a found problem or an incomplete run, 2 if the command fails.
    """


@cli.command()
@click.argument("protocol", type=_PATH)
@click.option(
    "--rig",
    "rig_path",
    type=_PATH,
    help="A rig file, to plan the size of the images too and to check the limits of the rig.",
)
@_JSON
@FORCE
def plan(protocol: Path, rig_path: Path | None, json_path: Path | None, force: bool) -> None:
    """Print the steps, the duration, the image size and the load limit of PROTOCOL. No device moves."""
    from rig import plan_protocol
    from rig.commands.plan import plan_dict, plan_lines

    require_places([protocol, rig_path], [json_path], force=force)
    made = plan_protocol(protocol, rig_path)
    _finish(plan_lines(made), plan_dict(made), json_path, good=not made.objections)


@cli.command()
@click.argument("protocol", type=_PATH)
@click.option("--rig", "rig_path", type=_PATH, required=True, help="The rig file.")
@click.option("-o", "--output", type=_PATH, help="The run file to write. Default: PROTOCOL's name with .h5.")
@click.option(
    "--continue",
    "continues",
    type=_PATH,
    metavar="RUN",
    help="Go on with this run, which ended early. Default of -o: RUN's name with -2 or the next number.",
)
@click.option(
    "--notify",
    metavar="COMMAND",
    help="Call this command once at the end of the run, with the message on its standard input.",
)
@click.option(
    "--http",
    type=click.IntRange(0, 65535),
    metavar="PORT",
    help="Answer HTTP requests of this computer at this port during the run; 0 is any free port.",
)
@_JSON
@FORCE
def run(
    protocol: Path,
    rig_path: Path,
    output: Path | None,
    continues: Path | None,
    notify: str | None,
    http: int | None,
    json_path: Path | None,
    force: bool,
) -> None:
    """Run PROTOCOL and write one run file. Ctrl-C holds the load frame, stops the stage and ends the run.

    With --continue, the finished steps of an earlier run are not repeated. If the specimen is in a load
    frame, the operator must first confirm that nobody has touched it.
    """
    from rig import plan_protocol
    from rig.commands.continuing import next_segment
    from rig.commands.running import end_lines, run_dict, run_on_screen

    run_path = output or (Path(f"{protocol.stem}.h5") if continues is None else next_segment(continues))
    inputs = [protocol, rig_path, run_path, *([] if continues is None else [continues])]
    require_places(inputs, [json_path], force=force)
    made = plan_protocol(protocol, rig_path)
    for caution in made.cautions:
        say(f"rig: caution: {caution}", err=True)
    with ExitStack() as ending:
        options: dict[str, Any] = {"continues": continues, "notify": notify, "http": http}
        outcome = run_on_screen(protocol, rig_path, run_path, ending, **options)
        lines = end_lines(run_path, outcome)
        table = run_dict(run_path, outcome) | {"limits": made.limits.table.rows()}
        good, recorded = outcome.is_good, outcome.recorded
        _finish(lines, table, json_path, good=good, done=recorded)


@cli.command()
@click.argument("rig_path", metavar="RIG", type=_PATH)
@click.option("-o", "--output", type=_PATH, help="Keep each camera's picture in this folder, as NAME.png.")
@click.option(
    "--delay",
    metavar="CHANNEL",
    help="Measure only the delay of this channel against the cameras: switch a light that the cameras see, "
    "whose voltage is the channel.",
)
@click.option(
    "--line",
    type=click.Choice(["rising", "falling"]),
    help="With --delay: the channel is no light but a line of the camera, its trigger or its exposure "
    "output. This edge of it is the beginning of an exposure.",
)
@click.option("--seconds", type=NumberRange(5.0, 600.0), help="Film for this time with --delay. Default: 30.")
@_JSON
@FORCE
def check(
    rig_path: Path,
    output: Path | None,
    delay: str | None,
    line: str | None,
    seconds: float | None,
    json_path: Path | None,
    force: bool,
) -> None:
    """Open the devices of RIG, read their state and take one image with each camera. No device moves.

    If a device fails, the other devices are still checked. Channels are read for two seconds; output lines
    give no pulse.
    """
    if delay is not None:
        if output is not None:
            raise click.UsageError("give -o only without --delay")
        _check_delay(rig_path, delay, line, seconds, json_path, force)
        return
    if seconds is not None or line is not None:
        raise click.UsageError("give --seconds and --line only with --delay")
    from rig import open_rig, read_rig
    from rig.commands.check import check_rig, keep_in
    from rig.guardian.lock import machines_locked

    rig_file = read_rig(rig_path)
    pictures = [] if output is None else [output / f"{name}.png" for name in rig_file.cameras]
    if output is not None:
        output.mkdir(parents=True, exist_ok=True)
    require_places([rig_path], [*pictures, json_path], force=force)
    failed: dict[str, str] = {}
    with machines_locked(rig_file), open_rig(rig_file, failed=failed) as rig:
        found = check_rig(rig) if output is None else check_rig(rig, keep_in(output))
    failed |= found.failed
    for sentence in failed.values():
        say(f"rig: {sentence}", err=True)
    lines = found.lines + [f"not good: {problem}" for problem in found.problems]
    table = {"devices": found.devices, "problems": found.problems, "failed": failed}
    _finish(lines, table, json_path, good=not found.problems, done=not failed)


def _check_delay(
    rig_path: Path, delay: str, line: str | None, seconds: float | None, json_path: Path | None, force: bool
) -> None:
    from rig import open_rig, read_rig
    from rig.commands.check_delay import SECONDS, measure_delay, measure_line_delay, only_delay

    rig_file, signal = only_delay(read_rig(rig_path), delay)
    require_places([rig_path], [json_path], force=force)

    def tell(sentence: str) -> None:
        say(f"rig: {sentence}", err=True)

    film_s = seconds or SECONDS
    with open_rig(rig_file) as rig:
        found = (
            measure_delay(rig, signal, film_s, tell)
            if line is None
            else measure_line_delay(rig, signal, film_s, rising=line == "rising", say=tell)
        )
    for sentence in found.failed.values():
        say(f"rig: {sentence}", err=True)
    lines = found.lines + [f"not good: {problem}" for problem in found.problems]
    table = {"delays": found.delays, "problems": found.problems, "failed": found.failed}
    _finish(lines, table, json_path, good=not (found.problems or found.failed), done=bool(found.delays))


@cli.command()
@click.option("--port", "ports", multiple=True, help="Also search this serial port. Repeatable.")
@click.option(
    "--modbus",
    "hosts",
    multiple=True,
    metavar="HOST[:PORT]",
    help="Also search this Modbus address. Repeatable.",
)
@click.option("--no-probe", is_flag=True, help="Do not query the devices; send nothing to any device.")
@click.option("-o", "--output", type=_PATH, help="Write a rig file with the found devices, to be edited.")
@_JSON
@FORCE
def devices(
    ports: tuple[str, ...],
    hosts: tuple[str, ...],
    no_probe: bool,
    output: Path | None,
    json_path: Path | None,
    force: bool,
) -> None:
    """List cameras, serial ports and the devices that answer. No device moves and no setting changes."""
    from rig.commands.device_search import search
    from rig.commands.devices import lines, rig_file, table

    require_places([], [output, json_path], force=force)
    found = search(list(ports), list(hosts), ask=not no_probe)
    if output is not None:
        _write(output, rig_file(found), "-o")
    _finish(lines(found), table(found), json_path, good=True)


@cli.command()
@click.argument("run_file", metavar="RUN", type=_PATH)
@click.option("-o", "--output", type=_PATH, help="Keep the replay's run file, under this name.")
@_JSON
@FORCE
def replay(run_file: Path, output: Path | None, json_path: Path | None, force: bool) -> None:
    """Feed RUN through the same engine again, and compare images, readings and steps bit by bit.

    No device is opened. Commands of the engine have no effect; readings and images are those of RUN.
    """
    from rig import replay_run
    from rig.commands.replay import replay_dict, replay_lines

    require_places([run_file, *([] if output is None else [output])], [json_path], force=force)
    replayed = replay_run(run_file, output)
    _finish(replay_lines(replayed), replay_dict(replayed), json_path, good=not replayed.differences)


@cli.command()
@click.argument("run_file", metavar="RUN", type=_PATH)
@_JSON
@FORCE
def verify(run_file: Path, json_path: Path | None, force: bool) -> None:
    """Check each image of RUN and RUN itself against their digests, and list what is missing.

    RUN may be an interrupted run.
    """
    from dataclasses import asdict

    from rig import verify_run

    require_places([run_file], [json_path], force=force)
    found = verify_run(run_file)
    of_all = "" if found.planned is None else f" of {found.planned} planned"
    lines = [f"{found.path}: {found.status}, {found.steps + found.overwritten}{of_all} steps"]
    if found.overwritten:
        lines += [f"the images of the newest {found.steps} steps are kept, as the protocol asks for"]
    lines += [
        f"{name}: {camera.valid} images, {camera.in_steps} in finished steps, {len(camera.damaged)} damaged"
        for name, camera in found.cameras.items()
    ]
    lines += [
        f"interlock {name}: {interlock.readings} readings, {interlock.outside} outside its range"
        for name, interlock in found.interlocks.items()
    ]
    lines += [
        f"channels.{name}: {channel.samples} samples, {channel.lost} lost, {channel.outside} out of range"
        for name, channel in found.channels.items()
    ]
    lines += [f"{name}: {text}" for name, timing in found.timing.items() for text in timing.sentences]
    lines += [f"digest: {found.digest}"]
    lines += [f"not good: {problem}" for problem in found.problems]
    _finish(lines, asdict(found) | {"path": str(found.path)}, json_path, good=not found.problems)


@cli.command()
@click.argument("run_file", metavar="RUN", type=_PATH)
@_JSON
@FORCE
def repair(run_file: Path, json_path: Path | None, force: bool) -> None:
    """Make RUN open again after its program was killed or the disk was full. No image is touched."""
    from rig import repair_run

    require_places([run_file], [json_path], force=force)
    repaired = repair_run(run_file)
    lines = [f"{repaired.path}: {change}; repaired" for change in repaired.changes]
    lines = [*lines, f"see what is in it: rig verify {run_file}"] if lines else ["nothing to repair"]
    _finish(lines, {"path": str(repaired.path), "changes": repaired.changes}, json_path, good=True)


@cli.command()
@click.argument("rig_path", metavar="[RIG]", type=_PATH, required=False)
@click.option("-o", "--output", type=_PATH, help="Write a rig file that uses the simulated devices.")
@click.option("--log", type=_PATH, help="Write the true state of the simulation, one JSON object per line.")
@click.option(
    "--period-s",
    type=NumberRange(0.001, 3600),
    default=0.1,
    show_default=True,
    help="Longest time between two samples in the log, in seconds.",
)
@click.option(
    "--fault", "faults", multiple=True, help="Start with this fault, such as stage.drop:2. Repeatable."
)
@click.option(
    "--at",
    "places",
    multiple=True,
    metavar="NAME=PLACE",
    help="The address of a server: a TCP port, such as load_frame=5020, or the path of a pseudo-terminal, "
    "such as stage=/tmp/stage. Repeatable. The other servers use any free address.",
)
@click.option("--list-faults", is_flag=True, help="Print all faults and exit.")
@_JSON
@FORCE
def simulate(
    rig_path: Path | None,
    output: Path | None,
    log: Path | None,
    period_s: float,
    faults: tuple[str, ...],
    places: tuple[str, ...],
    list_faults: bool,
    json_path: Path | None,
    force: bool,
) -> None:
    """Simulate a rig in real time until Ctrl-C. Other programs connect to the simulated devices.

    RIG is a rig file in which every device is simulated. Without RIG, the simulated rig has a stage, a load
    frame and two cameras. While the simulation runs, type help to list its commands.
    """
    from rig.commands.simulate import find_simulator, run, signals_noted, start

    if list_faults:
        _finish(find_simulator().list_faults(), {}, None, good=True)
        return
    # A log may also go to a pipe or a terminal, because it is never read again. So check only regular files.
    kept_log = log if log is not None and (log.is_file() or not log.exists()) else None
    require_places([rig_path], [output, kept_log, json_path], force=force)
    with signals_noted() as ending, closing(start(rig_path, log, faults, places)) as simulation:
        if output is not None:
            _write(output, simulation.rig_file(), "-o")
        addresses = dict(simulation.addresses)
        lines = [f"{name}: {address}" for name, address in addresses.items()]
        _finish(lines, addresses, json_path, good=True)
        run(simulation, ending, period_s, say)


@cli.command()
@click.option("-o", "--output", type=_PATH, default=Path("demo"), show_default=True, help="Output folder.")
def demo(output: Path) -> None:
    """Run the paper's tension and rotation tests and two tensile tests on virtual rigs, and write a report.

    The first tensile test gives E, Poisson's ratio and Rp0.2, which are printed beside the exact values. The
    second one is continuous; its live gauges are drawn beside the gauges from its images.
    """
    from rig.commands.demo import run_demo

    made = run_demo(output, say)
    for line in (*made.properties, *made.live):
        say(line)
    say(f"open {made.report.resolve()} and {made.curves.resolve()}")


for _command in (channels, focus, status, hold, unload, jog, queue, watch):
    cli.add_command(_command)
