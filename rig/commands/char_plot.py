"""A plot of curves made of characters, for a terminal.

A character of the Braille alphabet has two dots across and four down. Where a terminal cannot show these
characters, one character is one dot.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Points: TypeAlias = Sequence[tuple[float, float]]
Cell: TypeAlias = tuple[str, int]
"""A character, and the number of its curve; -1 for axes, texts and empty places."""

_SIGNS = " " + "".join(chr(0x2800 + bits) for bits in range(1, 256))
_PLAIN_SIGNS = " " + 255 * "*"
_DOTS = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]])
"""The bits of the dots of a Braille character, by row and column (Unicode, Braille Patterns)."""
_PARTS = 8.0
_STEPS = (1.0, 2.0, 5.0, 10.0)
_FARTHEST = 1e100
LEAST_COLUMNS, LEAST_ROWS = 30, 5
_NAMES = "123456789abcdefghijklmnopqrstuvwxyz"


@dataclass(frozen=True)
class Span:
    """The range of an axis, between two round numbers."""

    low: float
    high: float

    @classmethod
    def of(cls, values: NDArray[np.float64]) -> "Span":
        """Return the range with round ends that contains zero and all values."""
        low, high = min(0.0, float(values.min())), max(0.0, float(values.max()))
        width = high - low or 1.0
        size = 10.0 ** math.floor(math.log10(width / _PARTS))
        step = next(size * factor for factor in _STEPS if size * factor >= width / _PARTS)
        return cls(step * math.floor(low / step + 1e-9), step * max(1, math.ceil(high / step - 1e-9)))

    def place(self, values: NDArray[np.float64], dots: int) -> NDArray[np.float64]:
        """Return the places of values on `dots` dots, from 0 to dots - 1."""
        return (values - self.low) / (self.high - self.low) * (dots - 1)


def name_of_curve(number: int) -> str:
    """Return the character that marks the newest point of a curve, by its number from 0."""
    return _NAMES[number % len(_NAMES)]


def plot(
    curves: Mapping[str, Points], columns: int, rows: int, titles: tuple[str, str], *, braille: bool
) -> list[list[Cell]]:
    """Draw curves with axes.

    Parameters
    ----------
    curves : mapping of str to sequence of (float, float)
        Points of each curve in their order. Points with a value that no plot can show are left out.
    columns, rows : int
        The size of the whole plot in characters.
    titles : tuple of str
        What the axes show, across and up, with units.
    braille : bool
        False for a terminal that cannot show Braille characters.

    Returns
    -------
    list of list of (str, int)
        The lines from the top; no line is longer than `columns`. Empty if there is no point or no room.
    """
    arrays = [np.array(points, np.float64).reshape(-1, 2) for points in curves.values()]
    arrays = [points[(np.abs(points) < _FARTHEST).all(axis=1)] for points in arrays]
    known = [points for points in arrays if len(points)]
    if not known or columns < LEAST_COLUMNS or rows < LEAST_ROWS:
        return []
    every = np.concatenate(known)
    across, up = Span.of(every[:, 0]), Span.of(every[:, 1])
    top, bottom = f"{up.high:g}", f"{up.low:g}"
    margin = max(len(top), len(bottom)) + 1
    canvas = _Canvas(columns - margin - 1, rows - 3, across, up, braille=braille)
    for number, points in enumerate(arrays):
        canvas.draw(points, number)
    labels = [""] * canvas.rows
    labels[0], labels[-1] = top, bottom
    sign, corner, line = ("│", "└", "─") if braille else ("|", "+", "-")
    drawn = [_text(titles[1])]
    for label, cells in zip(labels, canvas.cells(), strict=True):
        drawn.append([*_text(f"{label:>{margin - 1}} {sign}"), *cells])
    drawn.append(_text(" " * margin + corner + line * canvas.columns))
    ends = f"{across.low:g}", f"{across.high:g}"
    middle = titles[0].center(max(0, canvas.columns + 1 - sum(map(len, ends))))
    drawn.append(_text(" " * margin + ends[0] + middle + ends[1]))
    return [cells[:columns] for cells in drawn]


def _text(text: str) -> list[Cell]:
    return [(sign, -1) for sign in text]


class _Canvas:
    """The dots of all curves, and the characters that stand for them."""

    def __init__(self, columns: int, rows: int, across: Span, up: Span, *, braille: bool) -> None:
        self.columns, self.rows = columns, rows
        self._across, self._up, self._braille = across, up, braille
        self._wide, self._high = (2, 4) if braille else (1, 1)
        self._bits = np.zeros((rows, columns), np.int64)
        self._curve = np.full((rows, columns), -1)
        self._ends: list[tuple[int, int, int]] = []

    def draw(self, points: NDArray[np.float64], number: int) -> None:
        """Draw the lines between the points of a curve, and mark its newest point."""
        if not len(points):
            return
        x = self._across.place(points[:, 0], self._wide * self.columns)
        y = self._high * self.rows - 1 - self._up.place(points[:, 1], self._high * self.rows)
        way = np.maximum(np.abs(np.diff(x)), np.abs(np.diff(y)))
        # at each point and at least once in each dot between two points
        at = np.concatenate([[0.0], np.cumsum(np.maximum(way, 1e-9))])
        fine = np.union1d(at, np.arange(0.0, at[-1], 0.5))
        columns, rows = (np.rint(np.interp(fine, at, each)).astype(int) for each in (x, y))
        cells = rows // self._high, columns // self._wide
        np.bitwise_or.at(self._bits, cells, _DOTS[rows % 4, columns % 2])
        self._curve[cells] = number
        self._ends.append((int(cells[0][-1]), int(cells[1][-1]), number))

    def cells(self) -> list[list[Cell]]:
        """Return the characters of all rows."""
        signs = _SIGNS if self._braille else _PLAIN_SIGNS
        rows = [
            [(signs[bits], curve) for bits, curve in zip(*row, strict=True)]
            for row in zip(self._bits.tolist(), self._curve.tolist(), strict=True)
        ]
        for row, column, number in self._ends:
            rows[row][column] = name_of_curve(number), number
        return rows
