"""Run the virtual rig for other programs: a loop that logs samples and executes typed commands."""

import os
import select
import signal
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, Protocol, cast

from rig import RigError, read_rig

GROUP = "offaxis.simulators"
NAME = "virtual-rig"
STDIN = 0
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Log(Protocol):
    """The record of the true state of the simulation."""

    def sample(self) -> None:
        """Write the present true state."""


class Simulation(Protocol):
    """What an entry point of the group `offaxis.simulators` returns for the tables of a rig file."""

    log: Log

    @property
    def addresses(self) -> Mapping[str, str]:
        """The address of each server."""

    def rig_file(self) -> str:
        """Return a rig file that uses this simulation."""

    def switch_on(self, fault: str) -> None:
        """Switch a fault on; ValueError if there is no such fault."""

    def command(self, line: str) -> list[str]:
        """Execute a typed line, and return the lines to print."""

    def close(self) -> None:
        """Stop every server."""


def find_simulator() -> Any:
    """Return the simulator that the entry point names.

    Raises
    ------
    RigError
        If it is not installed.
    """
    for point in entry_points(group=GROUP, name=NAME):
        return point.load()
    raise RigError(
        "rig simulate", f"a simulator {NAME!r} among the installed packages", "none", "install offaxis again"
    )


def start(
    rig_path: Path | None, log: Path | None, faults: Iterable[str], places: Iterable[str]
) -> Simulation:
    """Start the virtual rig that a rig file describes, or the default one.

    Parameters
    ----------
    rig_path, log : Path or None
    faults : iterable of str
        The faults that are on from the start.
    places : iterable of str
        ``NAME=PLACE``, the name of a server and its place.

    Raises
    ------
    ConfigurationError
        If the file has mistakes.
    RigError
        If the log cannot be written, a place is taken or malformed, or there is no such fault.
    """
    # Parse the text that was checked: the file may have changed since.
    tables = {} if rig_path is None else tomllib.loads(read_rig(rig_path).text)
    try:
        simulation = cast(
            Simulation, find_simulator()(tables, str(rig_path or "rig simulate"), log, tuple(places))
        )
    except OSError as error:
        raise RigError(
            "rig simulate",
            "a log that can be written, and places that are free",
            str(error),
            "name others with --log and --at",
        ) from error
    except ValueError as error:
        raise RigError("rig simulate", "a place", str(error), "see rig simulate --help") from error
    try:
        for fault in faults:
            simulation.switch_on(fault)
    except ValueError as error:
        simulation.close()
        raise RigError("rig simulate", "a fault", str(error), "see rig simulate --list-faults") from error
    return simulation


def run(simulation: Simulation, ending: int, period_s: float, say: Callable[[str], None]) -> None:
    """Log samples and execute typed commands until a signal or ``quit``.

    Parameters
    ----------
    simulation : Simulation
    ending : int
        The descriptor of `signals_noted`.
    period_s : float
        Time between two samples.
    say : callable
        Prints a line.
    """
    typed, typing = b"", True
    while True:
        simulation.log.sample()
        listened = [ending, STDIN] if typing and _in_foreground() else [ending]
        ready = select.select(listened, [], [], period_s)[0]
        if ending in ready:
            return
        if STDIN not in ready or not _in_foreground():
            continue
        try:
            received = os.read(STDIN, 4096)
        except OSError:
            received = b""
        # the end of the input ends the commands but not the simulation
        typing = bool(received)
        *lines, typed = (typed + received).split(b"\n")
        for line in lines:
            if line.strip() == b"quit":
                return
            for answer in simulation.command(line.decode(errors="replace")):
                say(answer)


def _in_foreground() -> bool:
    """Whether this program may read its terminal: the system suspends a background program that does."""
    try:
        return os.tcgetpgrp(STDIN) == os.getpgrp()
    except OSError:
        # no terminal
        return True


@contextmanager
def signals_noted() -> Iterator[int]:
    """Yield a descriptor that a signal makes readable; the signal does not end the program.

    A signal ends a wait for the descriptor at once, even a signal that comes just before the wait. A plain
    sleep would continue after either signal.
    """
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    waked = signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
    before = {number: signal.getsignal(number) for number in SIGNALS}
    # nohup has SIGHUP ignored: leave it ignored
    if before[signal.SIGHUP] is signal.SIG_IGN:
        del before[signal.SIGHUP]
    try:
        for number in before:
            signal.signal(number, lambda *_: None)
        yield reading
    finally:
        signal.set_wakeup_fd(waked)
        for number, handler in before.items():
            signal.signal(number, handler)
        os.close(reading)
        os.close(writing)
