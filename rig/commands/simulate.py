"""Running the virtual rig for other programs: a loop that samples, listens to the terminal, ends at once."""

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
    """Where the truth goes."""

    def sample(self) -> None:
        """Write what is true now."""


class Simulation(Protocol):
    """What an entry point of the group `offaxis.simulators` gives when called with a rig file's tables."""

    log: Log

    @property
    def addresses(self) -> Mapping[str, str]:
        """Where each server is."""

    def rig_file(self) -> str:
        """A rig file that uses it."""

    def switch_on(self, fault: str) -> None:
        """Let something go wrong; ValueError if there is no such fault."""

    def command(self, line: str) -> list[str]:
        """Carry out a line that was typed, and return what to print."""

    def close(self) -> None:
        """Stop every server."""


def find_simulator() -> Any:
    """Return what the entry point names.

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
    """Start the virtual rig that a rig file describes, or the one that there is without.

    Parameters
    ----------
    rig_path, log : Path or None
    faults : iterable of str
        Those it begins with.
    places : iterable of str
        ``NAME=PLACE``, where a server is to be.

    Raises
    ------
    ConfigurationError
        If the file has mistakes.
    RigError
        If the log cannot be written, a place is taken or none, or there is no such fault.
    """
    # From the very text that was found good: the file may have changed since.
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
    """Sample the truth, and do what is typed, until a signal or ``quit``.

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
        # at its end nobody types any more, but the rig goes on
        typing = bool(received)
        *lines, typed = (typed + received).split(b"\n")
        for line in lines:
            if line.strip() == b"quit":
                return
            for answer in simulation.command(line.decode(errors="replace")):
                say(answer)


def _in_foreground() -> bool:
    """Whether what is typed is for us: a program in the background that reads its terminal is suspended."""
    try:
        return os.tcgetpgrp(STDIN) == os.getpgrp()
    except OSError:
        # no terminal
        return True


@contextmanager
def signals_noted() -> Iterator[int]:
    """Let signals make a descriptor readable, which is yielded, instead of ending the program.

    A wait for a descriptor is over at once; a wait for time alone would go on after a signal, and one that
    comes just before the wait would be noticed only after it.
    """
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    waked = signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
    before = {number: signal.getsignal(number) for number in SIGNALS}
    # under nohup the end of the terminal ends nothing
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
