"""Functions for all commands of `rig`: the option for JSON, the printed lines and the exit status."""

import json
import math
import sys
from pathlib import Path
from typing import Any

import click

from dic.files.writing import write_text
from dic.shell.console import COULD_NOT, say
from rig import RigError

NOT_GOOD = 1


class NumberRange(click.FloatRange):
    """A range of numbers that also refuses NaN, because NaN is neither below nor above any bound."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Return the number. Raise a usage error if it is NaN or outside the range."""
        number: float = super().convert(value, param, ctx)
        if math.isnan(number):
            self.fail(f"{value!r} is not a number in the range {self._describe_range()}.", param, ctx)
        return number


PATH = click.Path(path_type=Path)
JSON = click.option("--json", "json_path", type=PATH, help="Also write the results to this file as JSON.")


def finish(
    lines: list[str], table: dict[str, Any], json_path: Path | None, *, good: bool, done: bool = True
) -> None:
    """Print lines, write a table as JSON, and exit with status 1 if the result is not good.

    If `done` is False, the command could not do its work, and the status is 2.
    """
    for line in lines:
        say(line)
    if json_path is not None:
        write(json_path, json.dumps(table, indent=2, allow_nan=False) + "\n", "--json")
    if not done:
        sys.exit(COULD_NOT)
    if not good:
        sys.exit(NOT_GOOD)


def write(path: Path, text: str, option: str) -> None:
    """Write a text file. Raise `RigError`, which names the option, if the file cannot be written."""
    try:
        write_text(path, text)
    except OSError as error:
        raise RigError(
            str(path),
            "a file that can be written",
            error.strerror or str(error),
            f"name another file with {option}",
        ) from error
