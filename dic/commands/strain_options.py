"""The options for strain that more than one subcommand has."""

from collections.abc import Callable
from typing import Any, TypeVar

import click

Command = TypeVar("Command", bound=Callable[..., Any])

_OPTIONS = (
    click.option(
        "--strain",
        "strain_measure",
        default="green-lagrange",
        show_default=True,
        help="green-lagrange, small or hencky.",
    ),
    click.option("--strain-window", default=5, show_default=True, help="Points across a local strain, odd."),
    click.option(
        "--strain-from",
        default="fit",
        show_default=True,
        help="Local strain: fit (of a plane to the window), quadratic-fit, or shape (function of a subset).",
    ),
)


def strain_options(command: Command) -> Command:
    """Add --strain, --strain-window and --strain-from, the arguments of `StrainSettings`."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command
