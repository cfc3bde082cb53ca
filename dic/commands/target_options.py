"""The options that say what a calibration image shows."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar

import click

if TYPE_CHECKING:
    from dic.targets.find import Target

Command = TypeVar("Command", bound=Callable[..., Any])


class _Count(click.ParamType[tuple[int, int]]):
    """A number along X and along Y, such as 21x21."""

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
    """A direction in the image: a word or an angle in degrees."""

    name = "right|up|left|down|DEGREES"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str | float:
        try:
            return float(value)
        except ValueError:
            # the word is judged where directions are known
            return str(value)


_OPTIONS = (
    click.option("--lines", type=_Count(), help="Lines along X and Y of a line grid.  [default: 21x21]"),
    click.option("--squares", type=_Count(), help="Instead: squares of a checkerboard, or a ChArUco board."),
    click.option("--dots", type=_Count(), help="Instead: dots of a lattice."),
    click.option(
        "--pitch-mm", type=float, default=0.5, show_default=True, help="Distance of lines, corners or dots."
    ),
    click.option("--marker-mm", type=float, help="Side of the markers: the squares are a ChArUco board's."),
    click.option(
        "--dictionary",
        default="DICT_5X5_100",
        show_default=True,
        help="The markers' dictionary, as OpenCV names it.",
    ),
    click.option(
        "--x-axis", type=_Direction(), help="Which way X points in the first image; degrees from right."
    ),
    click.option(
        "--origin-px",
        type=float,
        nargs=2,
        help="About where a line grid's middle is in the first image, if an outer line is hidden.",
    ),
)


def target_options(command: Command) -> Command:
    """Add the options of the target, all but --x-axis and --origin-px the arguments of `read_target`."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


def read_target(
    lines: tuple[int, int] | None,
    squares: tuple[int, int] | None,
    dots: tuple[int, int] | None,
    pitch_mm: float,
    marker_mm: float | None,
    dictionary: str,
) -> "Target":
    """Return the target that the options name.

    Raises
    ------
    CalibrationError
        If they name several, or none that could be.
    """
    from dic.errors import CalibrationError
    from dic.targets.find import CharucoTarget, CheckerboardTarget, DotTarget, LineGridTarget

    def refuse(step: str, expected: str, got: str, remedy: str) -> CalibrationError:
        return CalibrationError("settings", step, expected, got, remedy)

    # Squares of what is farther from a length would overflow.
    if not 1e-6 <= pitch_mm <= 1e6:
        expected = "a positive pitch, from 1e-06 to 1e+06 mm"
        raise refuse("pitch", expected, f"{pitch_mm:g} mm", "correct --pitch-mm")
    named = [f"--{name}" for name, n in (("lines", lines), ("squares", squares), ("dots", dots)) if n]
    if len(named) > 1:
        raise refuse("target", "one kind of target", " and ".join(named), "leave one of them")
    if marker_mm is not None and squares is None:
        raise refuse("target", "--squares with --marker-mm", "no squares", "name the board's squares")
    if squares is not None and marker_mm is not None:
        return CharucoTarget(squares, pitch_mm, marker_mm, dictionary)
    if squares is not None:
        return CheckerboardTarget(squares, pitch_mm)
    if dots is not None:
        return DotTarget(dots, pitch_mm)
    return LineGridTarget(lines or (21, 21), pitch_mm)
