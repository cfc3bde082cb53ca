"""Running the virtual rig for other programs: a loop that samples, listens to the terminal, ends at once."""

import os
import select
import signal
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, Protocol, cast

from drivers.settings import read_toml
from rig.errors import RigError

GROUP = "offaxis.simulators"
NAME = "virtual-rig"
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
        "rig simulate",
        expected=f"a simulator {NAME!r} among the installed packages",
        got="none",
        remedy="install offaxis again",
    )


def start(rig_path: Path | None, log: Path | None, faults: Iterable[str]) -> Simulation:
    """Start the virtual rig that a rig file describes, or the one that there is without.

    Raises
    ------
    ConfigurationError
        If the file has mistakes.
    RigError
        If the log cannot be written, or there is no such fault.
    """
    tables = {} if rig_path is None else read_toml(rig_path)
    try:
        simulation = cast(Simulation, find_simulator()(tables, str(rig_path or "rig simulate"), log))
    except OSError as error:
        raise RigError(
            str(log or "rig simulate"),
            expected="a file that can be written, and free ports",
            got=error.strerror or str(error),
            remedy="name another with --log",
        ) from error
    try:
        for fault in faults:
            simulation.switch_on(fault)
    except ValueError as error:
        simulation.close()
        raise RigError(
            "rig simulate", expected="a fault", got=str(error), remedy="see rig simulate --list-faults"
        ) from error
    return simulation


def run(simulation: Simulation, signals: Sequence[int], period_s: float, say: Callable[[str], None]) -> None:
    """Sample the truth, and do what is typed, until a signal or ``quit``.

    Parameters
    ----------
    simulation : Simulation
    signals : sequence of int
        Those of `signals_noted`.
    period_s : float
        Time between two samples.
    say : callable
        Prints a line.
    """
    typed, typing = b"", [sys.stdin.fileno()]
    while not signals:
        simulation.log.sample()
        if not select.select(typing, [], [], period_s)[0]:
            continue
        received = os.read(typing[0], 4096)
        if not received:
            # nobody types any more, but the rig goes on
            typing = []
        *lines, typed = (typed + received).split(b"\n")
        for line in lines:
            if line.strip() == b"quit":
                return
            for answer in simulation.command(line.decode(errors="replace")):
                say(answer)


@contextmanager
def signals_noted() -> Iterator[list[int]]:
    """Collect signals that end the simulation, instead of being ended by them."""
    seen: list[int] = []
    before = {number: signal.signal(number, lambda n, _: seen.append(n)) for number in SIGNALS}
    try:
        yield seen
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
