"""Command-line options for correlation and strain that several subcommands share."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dic.commands.option_groups import option_group

if TYPE_CHECKING:
    from dic import CorrelationSettings, StrainSettings

subset_option = click.option("--subset", default=41, show_default=True, help="Width of the subsets, odd, px.")
step_option = click.option("--step", default=10, show_default=True, help="Spacing of the points, px.")
shape_option = click.option(
    "--shape", default="quadratic", show_default=True, help="Shape function: affine or quadratic."
)
smoothing_option = click.option(
    "--smoothing",
    default="auto",
    show_default=True,
    help="Width (standard deviation) of the smoothing of all images before interpolation, px: a number,"
    " 0 for none, or auto (only if the pattern needs it).",
)
incremental_option = click.option(
    "--incremental",
    default="auto",
    show_default=True,
    help="When to take a new reference image: auto (when correlation drops), never, or always (each image).",
)
csv_option = click.option(
    "--csv",
    "csv_folder",
    type=click.Path(path_type=Path),
    help="Folder for CSV files: strain.csv with one line per image, and one file of points per image.",
)
gauges_option = click.option(
    "--gauges",
    "gauges_file",
    type=click.Path(path_type=Path),
    help="TOML file of gauges to read in each image. --csv and --json then also write the readings.",
)
comma_option = click.option(
    "--decimal-comma",
    is_flag=True,
    help="Write CSV files with decimal commas, and semicolons between the cells.",
)
fields_from_option = click.option(
    "--fields-from",
    type=click.Path(path_type=Path),
    help="Result file of the same images with the same settings of the correlation: its displacement fields"
    " are used, and nothing is correlated. Default: the file of -o, if it is such a file.",
)
COMMA_NEEDS = {"--decimal-comma": ["--csv"]}
"""Argument `needs` of `option_group`: `comma_option` has an effect only with one of these options."""
poisson_option = click.option(
    "--poisson-ratio", default=0.33, show_default=True, help="Poisson's ratio of the specimen, for bending."
)
shift_option = click.option(
    "--shift-std-um",
    type=float,
    help="Standard deviation of the specimen's shift towards the camera since the reference, µm:"
    " one camera cannot measure the shift. Default: 30; 5 with --tilt-axis-mm, for the shift that the tilt"
    " does not cause.",
)
hinge_option = click.option(
    "--tilt-axis-mm",
    "hinge_text",
    metavar="X,Y",
    help="Place of the grips' hinge in the grid's axes, mm, where the specimen keeps its distance to the"
    " camera: 0,-30 for a hinge 30 mm below the grid's centre. One number is Y. One camera then computes the"
    " shift from the tilt.",
)


def hinge_mm(text: str | None) -> tuple[float, float] | None:
    """Return the value of `--tilt-axis-mm` as X and Y in mm; None without the option.

    Raises
    ------
    CorrelationError
        If the text is neither one number nor two.
    """
    from dic import CorrelationError

    if text is None:
        return None
    try:
        numbers = [float(part) for part in text.split(",")]
        x, y = numbers if len(numbers) == 2 else (0.0, *numbers)
    except ValueError as error:
        expected, remedy = "X,Y in mm, or Y alone", "give --tilt-axis-mm 0,-30"
        raise CorrelationError("settings", "axis of the tilt", expected, text, remedy) from error
    return x, y


write_mask_option = click.option(
    "--write-mask",
    type=click.Path(path_type=Path),
    help="PNG file for the mask of the measured region; polygons (.toml) and a picture to check them"
    " (-overlay.png) are written beside it.",
)


def smoothing_px(text: str) -> float | str:
    """Return the value of `--smoothing` for `CorrelationSettings`: a number, or the text unchanged."""
    try:
        return float(text)
    except ValueError:
        return text


@dataclass(frozen=True)
class CorrelationOptions:
    """Options of the correlation."""

    subset: int
    step: int
    spline: int
    shape: str
    min_zncc: float
    smoothing: str

    def settings(self) -> "CorrelationSettings":
        """Return the options as `CorrelationSettings`."""
        from dic import CorrelationSettings

        return CorrelationSettings(
            subset_px=self.subset,
            step_px=self.step,
            shape=self.shape,
            order=self.spline,
            min_zncc=self.min_zncc,
            smoothing_px=smoothing_px(self.smoothing),
        )


correlation_options = option_group(
    "correlation",
    CorrelationOptions,
    subset_option,
    step_option,
    click.option(
        "--spline", default=5, show_default=True, help="Degree of the interpolating spline, 3 or 5."
    ),
    shape_option,
    click.option(
        "--min-zncc", default=0.8, show_default=True, help="Smallest correlation (ZNCC) of a good point."
    ),
    smoothing_option,
)


@dataclass(frozen=True)
class StrainOptions:
    """Options for the strain measure and its computation."""

    strain_measure: str | None
    strain_window: int | None
    strain_from: str | None

    def settings(self, known: "StrainSettings | None" = None) -> "StrainSettings":
        """Return the options as `StrainSettings`; if an option is None, its value comes from `known`."""
        from dic import StrainSettings

        values = zip(
            ("measure", "window_points", "source"),
            (self.strain_measure, self.strain_window, self.strain_from),
            strict=True,
        )
        given: dict[str, Any] = {name: value for name, value in values if value is not None}
        return replace(known or StrainSettings(), **given)


strain_options = option_group(
    "strain",
    StrainOptions,
    click.option(
        "--strain",
        "strain_measure",
        default="green-lagrange",
        show_default=True,
        help="Strain measure: green-lagrange, small or hencky.",
    ),
    click.option(
        "--strain-window", default=3, show_default=True, help="Width of the strain window in points, odd."
    ),
    click.option(
        "--strain-from",
        default="fit",
        show_default=True,
        help="Source of local strain: fit (plane in the strain window), quadratic-fit, or shape (function).",
    ),
)
