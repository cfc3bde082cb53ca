"""Run commands in forks of one process that has imported all modules, so that a start takes milliseconds.

The system measures CPU time and largest memory of each child. A child that does not end is killed.
"""

import json
import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

MOST_S = 20.0
"""CPU time in s after which the system ends a child. The child may also wait for the same time."""


@dataclass(frozen=True)
class Ended:
    """Result of a command. `status` is negative after a signal; the memory excludes the imported modules."""

    status: int
    out: str
    err: str
    cpu_s: float
    memory_bytes: int


class Forks:
    """A process that runs commands one after the other, each in a child process."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        # One thread each: a fork of a process with threads can hang.
        alone = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL", "NUMBA")}
        self._process = subprocess.Popen(
            [sys.executable, "-m", "tests.fuzz.forks"],
            env=os.environ | alone,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def run(self, arguments: list[str]) -> Ended:
        """Run a command line, wait for its end, and return the result."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(json.dumps({"arguments": arguments, "folder": str(self._folder)}) + "\n")
        self._process.stdin.flush()
        return Ended(**json.loads(self._process.stdout.readline()))

    def close(self) -> None:
        """End the process."""
        with self._process:
            self._process.kill()


@contextmanager
def forks(folder: Path) -> Iterator[Forks]:
    """Yield a process for commands, and end this process at the end of the block."""
    started = Forks(folder)
    try:
        yield started
    finally:
        started.close()


def _serve() -> None:
    _import_everything()
    for line in sys.stdin:
        print(json.dumps(asdict(_run(**json.loads(line)))), flush=True)


def _import_everything() -> None:
    import cv2
    import h5py  # noqa: F401
    import matplotlib.figure  # noqa: F401

    import dic
    import dic.cli
    import rig
    import rig.cli

    cv2.setNumThreads(1)
    for package in (dic, rig):
        for name in package.__all__:
            getattr(package, name)


def _run(arguments: list[str], folder: str) -> Ended:
    out, err = Path(folder) / "out", Path(folder) / "err"
    child = os.fork()
    if child == 0:
        _become(arguments, out, err)
    _, waited, usage = os.wait4(child, 0)
    return Ended(
        os.waitstatus_to_exitcode(waited),
        out.read_text(errors="replace"),
        err.read_text(errors="replace"),
        usage.ru_utime + usage.ru_stime,
        usage.ru_maxrss * 1024,
    )


def _become(arguments: list[str], out: Path, err: Path) -> Any:
    status = 70
    try:
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        signal.alarm(round(2 * MOST_S) + 20)
        resource.setrlimit(resource.RLIMIT_CPU, (round(MOST_S), round(MOST_S) + 1))
        for stream, path in ((1, out), (2, err)):
            os.dup2(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), stream)
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        os.chdir(out.parent)
        status = _main(arguments)
        sys.stdout.flush()
        sys.stderr.flush()
    finally:
        os._exit(status)


def _main(arguments: list[str]) -> int:
    import traceback

    import dic.cli
    import rig.cli

    sys.argv = arguments
    try:
        {"dic": dic.cli.main, "rig": rig.cli.main}[arguments[0]]()
    except SystemExit as end:
        return int(end.code or 0)
    except BaseException:
        traceback.print_exc()
        return 1
    return 0


if __name__ == "__main__":
    started_s = time.monotonic()
    _serve()
