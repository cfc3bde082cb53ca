"""Start recording programs in separate processes one after the other, and kill each of them.

A program imports everything once. For each line of standard input, the path of a run file, it forks a child
that records there, prints the child's number, and waits for the end of the child. The child prints a line
that begins with "step" for each step that is on the disk.
"""

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from queue import Queue

from tests.places import ROOT

_DEADLINE_S = 100.0


def serve(record: Callable[[Path], None]) -> None:
    """Fork a child that calls `record` for each path on standard input; the programs call this function."""
    for line in sys.stdin:
        child = os.fork()
        if child == 0:
            os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
            record(Path(line.strip()))
            os._exit(0)
        os.write(1, b"child %d\n" % child)
        os.waitpid(child, 0)
        os.write(1, b"ended\n")


class ForkedRuns:
    """A running program that calls `serve`, with a method that kills its children.

    Parameters
    ----------
    program : str
        The module of the program.
    """

    def __init__(self, program: str) -> None:
        # One thread each: a fork of a process with threads can hang.
        alone = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL", "NUMBA")}
        self._program = subprocess.Popen(
            [sys.executable, "-m", program],
            cwd=ROOT, env=os.environ | alone,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1,
        )  # fmt: skip
        self._lines: Queue[str] = Queue()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self._program.stdout is not None
        with self._program.stdout as lines:
            for line in lines:
                self._lines.put(line.strip())

    def killed(self, path: Path, steps: int, then_s: float) -> int:
        """Start a run, kill it `then_s` after `steps` steps, and return the number of acknowledged steps."""
        assert self._program.stdin is not None
        self._program.stdin.write(f"{path}\n")
        child, acknowledged = 0, 0
        while acknowledged < steps or not child:
            word, _, number = self._lines.get(timeout=_DEADLINE_S).partition(" ")
            child = int(number) if word == "child" else child
            acknowledged += word == "step"
        threading.Event().wait(then_s)
        os.kill(child, signal.SIGKILL)
        while (line := self._lines.get(timeout=_DEADLINE_S)) != "ended":
            acknowledged += line.startswith("step")
        return acknowledged

    def close(self) -> None:
        """End the program."""
        assert self._program.stdin is not None
        self._program.stdin.close()
        self._program.wait(60)
        self._reader.join(60)
