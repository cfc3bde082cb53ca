"""What a calibration target is: numbers and lengths, how it is found and printed, and its options."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import MISSING, Field, dataclass, fields
from typing import Any, ClassVar, NamedTuple, cast

from dic.errors import CalibrationError, Check, is_number, is_whole, require_all
from dic.targets.axes import XAxis
from dic.targets.points import GridPoints
from dic.targets.sheet.shapes import Shapes
from dic.typing import Grey

_PITCHES_MM = (1e-6, 1e6)
"""Smallest and largest possible pitch. The square of a length outside this range could overflow."""


class Hints(NamedTuple):
    """What the user knows of the target in an image: direction of X, and place of the middle intersection."""

    x_axis: XAxis = None
    origin_px: tuple[float, float] | None = None


class Target(ABC):
    """A calibration target of some kind and size.

    Each kind is a frozen data class. Its first field has the numbers of lines, squares or dots along X and
    along Y, its second field is `pitch_mm`. Each further field is an option of the commands; its metadata
    has the help text, `help`, and the length in pitches that is drawn by default, `in_pitches`.

    Attributes
    ----------
    name : str
        Name of the kind in protocols, run files and commands.
    title : str
        The kind in messages, such as "a line grid"; numbers and `counted` follow.
    printed : str
        Title of a printed sheet, with the numbers `x` and `y` and the fields in braces.
    counted : str
        Name of the first field: what the numbers of the target count.
    option : str
        Option of `dic calibrate` for the numbers, without "--". Kinds may share an option if their further
        options differ.
    option_help : str
        Help text of the option.
    fewest : int
        Smallest number along X and along Y.
    takes_origin : bool
        True if the finder uses the place of the middle intersection.
    about, about_counts : str
        Remarks for the help text of `dic target` about the kind and about its numbers; "" for none.
    """

    name: ClassVar[str]
    title: ClassVar[str]
    printed: ClassVar[str]
    counted: ClassVar[str]
    option: ClassVar[str]
    option_help: ClassVar[str]
    fewest: ClassVar[int]
    takes_origin: ClassVar[bool] = False
    about: ClassVar[str] = ""
    about_counts: ClassVar[str] = ""

    pitch_mm: float

    @classmethod
    def of(cls, counts: tuple[int, int], values: Mapping[str, Any]) -> "Target":
        """Return the target with these numbers; `values` has the pitch and the further fields by their names.

        A length that is None is the length that is drawn by default.
        """
        made: Any = cls
        pitch_mm = values["pitch_mm"]
        further = {
            name: each.metadata["in_pitches"] * pitch_mm if values[name] is None else values[name]
            for name, each in cls.further().items()
        }
        return cast(Target, made(counts, pitch_mm, **further))

    @classmethod
    def further(cls) -> "dict[str, Field[Any]]":
        """Return the fields after the pitch, by their names."""
        every: Any = cls
        return {each.name: each for each in fields(every)[2:]}

    @classmethod
    def needed(cls) -> list[str]:
        """Return the names of the further fields without a default."""
        return [name for name, each in cls.further().items() if each.default is MISSING]

    @property
    def counts(self) -> tuple[int, int]:
        """Numbers of lines, squares or dots along X and along Y."""
        first, second = getattr(self, self.counted)
        return first, second

    @property
    def description(self) -> str:
        """The kind and the size of the target, for the title of a printed sheet."""
        return self.printed.format(x=self.counts[0], y=self.counts[1], **vars(self))

    @property
    def options(self) -> str:
        """The options of `dic calibrate` that describe the target."""
        values = {name: getattr(self, name) for name in ("pitch_mm", *self.further())}
        given = (f"{option_of(name)} {_text(value)}" for name, value in values.items())
        return " ".join([f"--{self.option} {self.counts[0]}x{self.counts[1]}", *given])

    @abstractmethod
    def find(self, grey: Grey, source: str, hints: Hints) -> GridPoints:
        """Return the points of the target in an image; raise a `CalibrationError` if too few are visible."""

    @abstractmethod
    def shapes(self) -> Shapes:
        """Return the dark areas of the target on a printed sheet."""

    def is_shown_as(self, seen: "SeenTarget") -> bool:
        """Return True if the target that was seen is of this kind and size."""
        return seen.kind is type(self) and sorted(seen.counts) == sorted(self.counts)

    def require_possible(self, source: str) -> None:
        """Raise a CalibrationError if there is no such target; the message names all mistakes."""
        self._require_numbers(source)
        least_mm, most_mm = _PITCHES_MM
        pitch: Check = (
            self._pitch_is_possible,
            "pitch",
            f"{least_mm:g} to {most_mm:g} mm",
            f"{self.pitch_mm:g} mm",
            "give --pitch-mm 0.5",
        )
        require_all(CalibrationError, source, [pitch, *self._checks()])

    @property
    def _pitch_is_possible(self) -> bool:
        return _PITCHES_MM[0] <= self.pitch_mm <= _PITCHES_MM[1]

    def _checks(self) -> list[Check]:
        """Return the checks of the numbers and of the further fields."""
        return [self._enough()]

    def _enough(self, otherwise: str = "") -> Check:
        """Return the check of the numbers; `otherwise` is another remedy, after the first."""
        first, second = self.counts
        possible = f"{max(first, self.fewest)}x{max(second, self.fewest)}"
        return (
            min(self.counts) >= self.fewest,
            f"number of {self.counted}",
            f"at least {self.fewest} along X and along Y",
            f"{first} × {second}",
            f"give --{self.option} {possible}{otherwise}",
        )

    def _require_numbers(self, source: str) -> None:
        """Raise an error if a length or a count is no number, such as lines=21 for lines=(21, 21)."""
        checks: list[Check] = []
        for name, value in vars(self).items():
            if name.endswith("_mm"):
                checks.append((is_number(value), name, "a number", repr(value), f"give {name}=0.5"))
            elif name == self.counted:
                pair = isinstance(value, tuple | list) and len(value) == 2 and all(map(is_whole, value))
                checks.append((pair, name, "two whole numbers, (X, Y)", repr(value), f"give {name}=(21, 21)"))
        require_all(CalibrationError, source, checks)


@dataclass(frozen=True)
class SeenTarget:
    """A target that an image shows."""

    kind: type[Target]
    """The class of the target."""
    counts: tuple[int, int]
    """Numbers of lines, squares or dots along both directions. For an asymmetric grid of dots: number of dots
    in a row, and number of rows.
    """
    dictionary: str = ""
    """Smallest of OpenCV's dictionaries that has all markers of a ChArUco board; empty for other targets."""

    def __str__(self) -> str:
        first, second = self.counts
        numbers = f"{self.kind.title} of {first} × {second} {self.kind.counted}"
        return f"{numbers} with markers of {self.dictionary}" if self.dictionary else numbers

    @property
    def options(self) -> str:
        """The options of the commands that describe the target, except for its lengths in mm."""
        further = (f"{option_of(name)} {getattr(self, name, '…')}" for name in self.kind.further())
        return " ".join([f"--{self.kind.option} {self.counts[0]}x{self.counts[1]}", *further])


def option_of(name: str) -> str:
    """Return the option of a field, such as "--pitch-mm" of `pitch_mm`."""
    return f"--{name.replace('_', '-')}"


def _text(value: str | float) -> str:
    return value if isinstance(value, str) else f"{value:g}"
