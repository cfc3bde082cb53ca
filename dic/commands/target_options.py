"""Command-line options that describe a calibration target, derived from the kinds of targets."""

from __future__ import annotations

from dataclasses import MISSING, make_dataclass
from typing import Any, get_type_hints

import click

import dic
from dic.commands.options import option, options, use
from dic.errors import CalibrationError
from dic.targets import TARGETS


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
PITCH = "Spacing of lines, corners, or dots in a row."

Field = tuple[str, Any, Any]
"""Name, type and option of a field of a group of options."""


def further_fields(*, drawn: bool = False) -> list[Field]:
    """Return the options that only some kinds of targets have, such as --marker-mm.

    If the target is drawn, an option has a default in pitches where the kind has one.
    """
    found: dict[str, Field] = {}
    for kind in TARGETS.values():
        for name, each in kind.further().items():
            pitches = each.metadata.get("in_pitches") if drawn else None
            sentence = each.metadata["help"] + (f"  [default: {pitches:g} pitches]" if pitches else "")
            default = None if each.default is MISSING else each.default
            declared = option(_option(name), help=sentence, default=default)
            found.setdefault(name, (name, get_type_hints(kind)[name], declared))
    return list(found.values())


def _option(name: str) -> str:
    return f"--{name.replace('_', '-')}"


_Described: Any = make_dataclass(
    "_Described",
    [
        *(
            (name.replace("-", "_"), tuple[int, int], option(_option(name), type=COUNT, help=sentence))
            for name, sentence in {kind.option: kind.option_help for kind in TARGETS.values()}.items()
        ),
        ("pitch_mm", float, option("--pitch-mm", default=0.5, help=PITCH)),
        *further_fields(),
    ],
    frozen=True,
)


@options
class TargetOptions(_Described):  # type: ignore[misc]  # its fields are those of the kinds of targets
    """Options for the target in the image, and for the direction of its axes."""

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

    def read(self) -> dic.targets.Target:
        """Return the target that the options describe.

        Raises `CalibrationError` if the options name several kinds of target, or if an option such as
        `--marker-mm` is given without the numbers of its kind.
        """
        given: dict[str, Any] = {name: value for name, value in vars(self).items() if value is not None}
        numbers = {kind.option: given.get(kind.option.replace("-", "_")) for kind in TARGETS.values()}
        named = [option for option, counts in numbers.items() if counts]
        if len(named) > 1:
            got, remedy = " and ".join(map(_option, named)), f"leave out {_option(named[-1])}"
            raise CalibrationError("settings", "target", "one kind of target", got, remedy)
        for kind in TARGETS.values():
            for name in given.keys() & set(kind.needed()):
                if kind.option not in named:
                    expected, noun = f"--{kind.option} with {_option(name)}", kind.title.rpartition(" ")[2]
                    remedy = f"name the {noun}'s {kind.counted}: --{kind.option} 10x9"
                    raise CalibrationError("settings", "target", expected, f"no {kind.counted}", remedy)
        if not named:
            return dic.targets.LineGridTarget(pitch_mm=self.pitch_mm)
        # Kinds with the same option for their numbers differ in the further options that they need.
        kinds = [
            each
            for each in TARGETS.values()
            if each.option == named[0] and given.keys() >= set(each.needed())
        ]
        counts: Any = numbers[named[0]]
        return max(kinds, key=lambda kind: len(kind.needed())).of(counts, given)


target_options = use("target", TargetOptions)
