"""Run the virtual rig for other programs. A loop records its true state and executes typed commands."""

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
    """The log of the true state of the simulation."""

    def sample(self) -> None:
        """Write the current true state of the simulation to the log."""


class SimulatedRig(Protocol):
    """The simulation that an entry point of the group `offaxis.simulators` makes from a rig file's tables."""

    log: Log
    say: Callable[[str], None]

    @property
    def addresses(self) -> Mapping[str, str]:
        """The address of each server."""

    def rig_file(self) -> str:
        """Return a rig file that uses this simulation."""

    def switch_on(self, fault: str) -> None:
        """Switch a fault on. Raise `ValueError` if the fault does not exist."""

    def command(self, line: str) -> list[str]:
        """Execute a typed command, and return the lines to print."""

    def close(self) -> None:
        """Stop every server."""


def find_simulator() -> Any:
    """Return the function that starts the virtual rig, from the entry points of the installed packages.

    Raise `RigError` if no installed package has the entry point.
    """
    for point in entry_points(group=GROUP, name=NAME):
        return point.load()
    raise RigError(
        "rig simulate", f"a simulator {NAME!r} among the installed packages", "none", "install offaxis again"
    )


def start(
    rig_path: Path | None, log: Path | None, faults: Iterable[str], places: Iterable[str]
) -> SimulatedRig:
    """Start the virtual rig that a rig file describes, or the default virtual rig.

    `log` is the log file for the true state, and `faults` are on from the start. Each of `places` is
    ``NAME=PLACE``: the name of a server, and its TCP port or the path of its pseudo-terminal. Raise
    `ConfigurationError` if the rig file has mistakes, and `RigError` if the log cannot be written, a place is
    in use or malformed, or a fault does not exist.
    """
    # Parse the text that was checked, because the file itself may have changed since.
    tables = {} if rig_path is None else tomllib.loads(read_rig(rig_path).text)
    try:
        simulation = cast(
            SimulatedRig, find_simulator()(tables, str(rig_path or "rig simulate"), log, tuple(places))
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


def run(simulation: SimulatedRig, ending: int, period_s: float, say: Callable[[str], None]) -> None:
    """Write samples to the log and execute typed commands, until a signal or the command ``quit``.

    `ending` is the file descriptor that `signals_noted` yields. `period_s` is the longest time between two
    samples, in s. `say` prints a line.
    """
    typed, typing = b"", True
    simulation.say = say
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
        # at the end of the input there are no more commands, but the simulation continues
        typing = bool(received)
        *lines, typed = (typed + received).split(b"\n")
        for line in lines:
            if line.strip() == b"quit":
                return
            for answer in simulation.command(line.decode(errors="replace")):
                say(answer)


def _in_foreground() -> bool:
    """Return True if this program may read its terminal.

    The system suspends a background program that reads its terminal.
    """
    try:
        return os.tcgetpgrp(STDIN) == os.getpgrp()
    except OSError:
        # standard input is not a terminal, so reading it does not suspend the program
        return True


@contextmanager
def signals_noted() -> Iterator[int]:
    """Yield a file descriptor that becomes readable when a signal arrives.

    The signal does not end the program.

    A wait for the descriptor ends at once, even if the signal arrived just before the wait. A plain sleep
    would continue after the signal.
    """
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    waked = signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
    before = {number: signal.getsignal(number) for number in SIGNALS}
    # under nohup, SIGHUP is ignored and must stay ignored
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
