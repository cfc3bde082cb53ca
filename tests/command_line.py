"""Run the commands `dic` and `rig` in tests, either in the test's process or as separate programs."""

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
DEADLINE_S = 300.0
"""Time in s after which a test stops waiting for the end of a program; it is below the limit of a test."""


@dataclass(frozen=True)
class Ended:
    """Result of a command: arguments, exit status, and the text of standard output and standard error."""

    arguments: list[str]
    status: int
    out: str
    err: str

    @property
    def report(self) -> Any:
        """The content of the JSON file that the command wrote for the option `--json`."""
        return json.loads(Path(self.arguments[self.arguments.index("--json") + 1]).read_text())


def run_dic(*arguments: object, out: TextIO | None = None) -> Ended:
    """Run `dic` in this process. If `out` is given, it is the standard output of the command."""
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
    """Run `rig` in this process. If `out` is given, it is the standard output of the command."""
    return _run("rig", arguments, out)


def run_both(*arguments: object, out: TextIO | None, err: TextIO | None) -> int:
    """Run `dic` or `rig`, the first argument, with the given output streams, and return the exit status.

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
    """A program, by default `rig`, that runs in a separate process until it ends or `close` kills it."""

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
        """Read the program's output up to a line with the given beginning; return the lines."""
        assert self.process.stdout is not None
        assert self.process.stderr is not None
        lines = []
        for line in self.process.stdout:
            lines.append(line.strip())
            if line.startswith(beginning):
                return lines
        raise AssertionError(f"{lines}, {self.process.stderr.read()}")

    def type(self, lines: str) -> None:
        """Write lines to the program's standard input."""
        assert self.process.stdin is not None
        self.process.stdin.write(f"{lines}\n")

    def end(self, typed: str = "") -> tuple[int, str]:
        """Write the last input, wait for the program's end; return its exit status and its standard error."""
        _, complaints = self.process.communicate(typed, timeout=DEADLINE_S)
        return self.process.returncode, complaints

    def close(self) -> None:
        """Kill the program if it has not ended."""
        with self.process:
            self.process.kill()
