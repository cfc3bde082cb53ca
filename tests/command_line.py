"""Our commands as a person runs them, in this process or as programs of their own."""

import io
import json
import sys
from collections.abc import Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from subprocess import PIPE, Popen
from typing import Any, TextIO
from unittest.mock import patch

import pytest

import dic.cli
import rig.cli

RIG = [sys.executable, "-c", "from rig.cli import main; main()"]
DEADLINE_S = 100.0
"""When a program is given up that does not end, below the limit of a test."""


@dataclass(frozen=True)
class Ended:
    """How a command ended: its status, and what it printed on both streams."""

    arguments: list[str]
    status: int
    out: str
    err: str

    @property
    def report(self) -> Any:
        """What it wrote to the file that `--json` names."""
        return json.loads(Path(self.arguments[self.arguments.index("--json") + 1]).read_text())


def run_dic(*arguments: object, out: TextIO | None = None) -> Ended:
    """Run `dic` in this process; what it prints goes to `out` if one is given."""
    return _run("dic", arguments, out)


def refusal(*arguments: object) -> str:
    """Run `dic`, which must end with status 2 and one sentence; return that sentence."""
    done = run_dic(*arguments)
    # click puts two lines about the usage before its own sentences
    said = [line for line in done.err.splitlines() if line and not line.startswith(("Usage: ", "Try "))]
    assert (done.status, len(said)) == (2, 1), done
    assert said[0].lower().startswith("error: ")
    return said[0]


def run_rig(*arguments: object, out: TextIO | None = None) -> Ended:
    """Run `rig` in the same way."""
    return _run("rig", arguments, out)


def run_both(*arguments: object, out: TextIO | None, err: TextIO | None) -> int:
    """Run `dic` or `rig`, named by the first argument, on two streams, and return its status.

    A stream may be None, as in a program whose stream was closed before its start.
    """
    typed = list(map(str, arguments))
    with (
        patch.object(sys, "argv", typed),
        redirect_stdout(out),
        redirect_stderr(err),
        pytest.raises(SystemExit) as ended,
    ):
        {"dic": dic.cli.main, "rig": rig.cli.main}[typed[0]]()
    return int(ended.value.code or 0)


def _run(program: str, arguments: Sequence[object], out: TextIO | None) -> Ended:
    printed, complaints = io.StringIO(), io.StringIO()
    status = run_both(program, *arguments, out=out or printed, err=complaints)
    return Ended([program, *map(str, arguments)], status, printed.getvalue(), complaints.getvalue())


class Program:
    """`rig` in a process of its own, which ends with the test."""

    def __init__(self, *arguments: object, command: Sequence[str] = RIG, stdin: int = PIPE) -> None:
        self.process = Popen(
            [*command, *map(str, arguments)],
            stdin=stdin,
            stdout=PIPE,
            stderr=PIPE,
            text=True,
            bufsize=1,
        )

    def wait_for(self, beginning: str) -> list[str]:
        """Read what it prints up to a line that begins so."""
        assert self.process.stdout is not None
        assert self.process.stderr is not None
        lines = []
        for line in self.process.stdout:
            lines.append(line.strip())
            if line.startswith(beginning):
                return lines
        raise AssertionError(f"{lines}, {self.process.stderr.read()}")

    def type(self, lines: str) -> None:
        """Type into it."""
        assert self.process.stdin is not None
        self.process.stdin.write(f"{lines}\n")

    def end(self, typed: str = "") -> tuple[int, str]:
        """Type the last lines, wait for its end; return its status and what it complained of."""
        _, complaints = self.process.communicate(typed, timeout=DEADLINE_S)
        return self.process.returncode, complaints

    def close(self) -> None:
        """Kill it if it has not ended."""
        with self.process:
            self.process.kill()
