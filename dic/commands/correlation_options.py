"""The options for correlation and strain that several subcommands share."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import click

from dic.commands.option_groups import option_group

if TYPE_CHECKING:
    from dic import StrainSettings

subset_option = click.option("--subset", default=31, show_default=True, help="Width of the subsets, odd, px.")
step_option = click.option("--step", default=10, show_default=True, help="Distance of the points, px.")
incremental_option = click.option(
    "--incremental",
    default="auto",
    show_default=True,
    help="New reference: auto (when the correlation drops), never, or always (each image before).",
)
poisson_option = click.option(
    "--poisson-ratio", default=0.33, show_default=True, help="Of the specimen, for its bending."
)


@dataclass(frozen=True)
class StrainOptions:
    """The strain measure, and how it is computed."""

    strain_measure: str
    strain_window: int
    strain_from: str

    def settings(self) -> "StrainSettings":
        """Return the options as the library's type."""
        from dic import StrainSettings

        return StrainSettings(self.strain_measure, self.strain_window, self.strain_from)


strain_options = option_group(
    "strain",
    StrainOptions,
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
