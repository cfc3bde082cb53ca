"""Command-line options that describe the target in a calibration image."""

from typing import TYPE_CHECKING, Any

import click

from dic.commands.options import option, options, use

if TYPE_CHECKING:
    from dic import Target


class _Count(click.ParamType[tuple[int, int]]):
    """An option with a number along X and a number along Y, such as 21x21."""

    name = "NxM"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[int, int]:
        if isinstance(value, tuple):
            return value
        parts = str(value).lower().replace("×", "x").split("x")
        if len(parts) != 2 or not all(part.isascii() and part.isdigit() for part in parts):
            self.fail(f"expected numbers along X and along Y, such as 21x21, got {value!r}", param, ctx)
        return int(parts[0]), int(parts[1])


class _Direction(click.ParamType[str | float]):
    """An option with a direction in the image: right, up, left, down, or an angle in degrees."""

    name = "right|up|left|down|DEGREES"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str | float:
        try:
            return float(value)
        except ValueError:
            # `dic.targets` checks the word later.
            return str(value)


COUNT = _Count()


@options
class TargetOptions:
    """Options for the target in the image, and for the direction of its axes."""

    lines: tuple[int, int] | None = option(
        "--lines", type=COUNT, help="Numbers of lines of a line grid.  [default: 21x21]"
    )
    squares: tuple[int, int] | None = option(
        "--squares", type=COUNT, help="Numbers of squares of a checkerboard or ChArUco board, if used."
    )
    dots: tuple[int, int] | None = option(
        "--dots", type=COUNT, help="Numbers of dots of a dot target, if used."
    )
    asymmetric_dots: tuple[int, int] | None = option(
        "--asymmetric-dots",
        type=COUNT,
        help="Dots in a row and rows of an asymmetric grid of dots, such as 4x11, if used.",
    )
    pitch_mm: float = option("--pitch-mm", default=0.5, help="Spacing of lines, corners, or dots in a row.")
    marker_mm: float | None = option("--marker-mm", help="Side of the markers, only for a ChArUco board.")
    dictionary: str = option(
        "--dictionary", default="DICT_5X5_100", help="OpenCV's name for the dictionary of the markers."
    )
    x_axis: str | float | None = option(
        "--x-axis",
        type=_Direction(),
        help="Direction of X in the first image, as a word or in degrees from right.",
    )
    origin_px: tuple[float, float] | None = option(
        "--origin-px",
        type=float,
        nargs=2,
        help="Rough image point x y of a line grid's centre in the first image, if an outer line is hidden.",
    )
    region: tuple[float, float, float, float] | None = option(
        "--region",
        type=float,
        nargs=4,
        help="Left, top, width and height in px of the part of every image that shows the target.",
    )

    def read(self) -> "Target":
        """Return the target that the options describe.

        Raises
        ------
        CalibrationError
            If the options name several kinds of target, or if `--marker-mm` is given without `--squares`.
        """
        from dic import (
            AsymmetricDotTarget,
            CalibrationError,
            CharucoTarget,
            CheckerboardTarget,
            DotTarget,
            LineGridTarget,
        )

        kinds = ("lines", "squares", "dots", "asymmetric_dots")
        named = [f"--{name.replace('_', '-')}" for name in kinds if getattr(self, name)]
        if len(named) > 1:
            got, remedy = " and ".join(named), f"leave out {named[-1]}"
            raise CalibrationError("settings", "target", "one kind of target", got, remedy)
        if self.marker_mm is not None and self.squares is None:
            expected, remedy = "--squares with --marker-mm", "name the board's squares: --squares 10x9"
            raise CalibrationError("settings", "target", expected, "no squares", remedy)
        if self.squares is not None and self.marker_mm is not None:
            return CharucoTarget(self.squares, self.pitch_mm, self.marker_mm, self.dictionary)
        if self.squares is not None:
            return CheckerboardTarget(self.squares, self.pitch_mm)
        if self.dots is not None:
            return DotTarget(self.dots, self.pitch_mm)
        if self.asymmetric_dots is not None:
            return AsymmetricDotTarget(self.asymmetric_dots, self.pitch_mm)
        return LineGridTarget(self.lines or (21, 21), self.pitch_mm)


target_options = use("target", TargetOptions)
