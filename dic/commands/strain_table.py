"""The table of mean strains that `dic correlate` and `dic process` print, at most 100 characters wide."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

KINDS = ("raw", "calibrated", "corrected")
COMPONENTS = ("exx", "eyy", "exy")
_KIND_WIDTH = len("calibrated")
_VALUE_WIDTH, _STD_WIDTH = 7, 5


@dataclass(frozen=True)
class Column:
    """A column in front of the strains, with heading and width; numbers are aligned right.

    A text that is longer than the width is cut at its beginning, because the names in a series differ at
    their ends.
    """

    heading: str
    width: int
    number: bool = True

    def cell(self, text: str) -> str:
        """Return a text with the width of the column."""
        if len(text) > self.width and not self.number:
            text = "…" + text[len(text) - self.width + 1 :]
        return text.rjust(self.width) if self.number else text.ljust(self.width)


@dataclass(frozen=True)
class StrainTable:
    """The lines of a table with a line for each kind of strain of an image: raw, calibrated and corrected."""

    columns: Sequence[Column]
    """The columns in front of the strains."""
    only_raw: bool = False
    """True if there is no calibration. Then all strain is raw, and no column names the kind of strain."""

    def heading(self) -> str:
        """Return the line above the table."""
        front = " ".join(column.cell(column.heading) for column in self.columns)
        strains = "  ".join(f"{name:>{_VALUE_WIDTH}} ± {'':<{_STD_WIDTH - 2}}" for name in COMPONENTS)
        kind = "" if self.only_raw else " " * (_KIND_WIDTH + 1)
        return f"{front} {kind}{strains}µε"

    def lines(self, cells: Sequence[str], strains: Mapping[str, Mapping[str, Any]]) -> list[str]:
        """Return the lines of one image.

        `cells`: the text of each column in front of the strains. `strains`: for each kind of strain that was
        measured, the values `exx`, `exx_std` and so on; None or NaN for a value that is not known. A kind
        without values gets no line.
        """
        front = " ".join(column.cell(text) for column, text in zip(self.columns, cells, strict=True))
        lines = []
        for kind in KINDS:
            found = strains.get(kind, {})
            values = [strain_text(found.get(name), found.get(f"{name}_std")) for name in COMPONENTS]
            if any(value.strip() for value in values):
                named = "" if self.only_raw else f"{kind:<{_KIND_WIDTH}} "
                lines.append(f"{front} {named}{'  '.join(values)}".rstrip())
                front = " " * len(front)
        return lines or [f"{front} no mean strain"]


def strain_text(value: float | None, std: float | None) -> str:
    """Return a strain and its standard deviation in µε; spaces if the strain is not known.

    If the standard deviation is below 9.5 µε, both numbers have one decimal.
    """
    if value is None or value != value:
        return " " * (_VALUE_WIDTH + _STD_WIDTH + 1)
    known = std is not None and std == std
    digits = 1 if std is not None and known and 1e6 * std < 9.5 else 0
    deviation = f" ± {1e6 * std:.{digits}f}" if std is not None and known else ""
    return f"{1e6 * value:z{_VALUE_WIDTH}.{digits}f}{deviation:<{_STD_WIDTH + 1}}"


def share_text(summary: Mapping[str, Any]) -> str:
    """Return the share of all points that have a value, rounded down, so that 100 % means all points."""
    points = summary["points"] + summary["out_of_view"]
    return f"{1000 * summary['converged'] // max(1, points) / 10:.1f}"
