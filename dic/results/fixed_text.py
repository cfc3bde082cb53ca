"""Many lines of a table as bytes at once: numbers with a fixed number of decimals, and texts of few kinds.

Cells have a fixed width and are filled with zero bytes, which are removed at the end. The bytes are those
that Python's own formatting writes, at a tenth of its time.
"""

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dic.typing import Float

_WHOLE_MAX = 10_000
"""Numbers from here on are left to Python."""
_HEAD_BYTES = 8
_GROUP = 4
"""Decimals are written in groups of this number of digits, and the rest of them last."""


class FixedLines:
    """Lines of equal length, whose cells are filled column by column.

    `count`: number of lines. `separator`: between cells. `point`: the decimal point.
    """

    def __init__(self, count: int, separator: str, point: str) -> None:
        self._separator, self._point = separator, point
        self._cells: list[NDArray[np.uint8]] = []
        self.doubtful = np.zeros(count, bool)
        """True for lines that Python must write instead: a number is too large, or so near the middle between
        two decimals that a product of floating-point numbers does not show how it is rounded.
        """

    def add_texts(self, texts: Sequence[str], index: NDArray[Any]) -> None:
        """Add a column with the text `texts[i]` for the index i of each line."""
        before = self._separator if self._cells else ""
        known = np.array([(before + text).encode() for text in texts])
        self._cells.append(known[index][:, None].view(np.uint8))

    def add_numbers(self, values: Float, digits: int) -> None:
        """Add columns of numbers (lines, columns); NaN becomes an empty cell."""
        with np.errstate(over="ignore"):
            scaled = np.abs(values) * 10.0**digits
        empty, doubtful = np.isnan(values), scaled >= (_WHOLE_MAX - 1) * 10.0**digits
        scaled[empty | doubtful] = 0.0
        # The product is wrong by at most 2⁻⁵³ of itself.
        doubtful |= np.abs(scaled - np.floor(scaled) - 0.5) <= scaled * 2.0**-52
        self.doubtful |= doubtful.any(axis=1)
        units = np.rint(scaled).astype(np.int64)
        whole = units // 10**digits
        decimals = (units - whole * 10**digits).astype(np.uint32)
        whole += _WHOLE_MAX * ((values < 0.0) & (units > 0))
        whole[empty] = 2 * _WHOLE_MAX
        groups = [_GROUP] * (digits // _GROUP) + [digits % _GROUP] * (digits % _GROUP > 0)
        parts = np.dtype([("head", np.uint64), *((f"{k}", np.uint32) for k in range(len(groups)))])
        cells = np.empty(values.shape, parts)
        cells["head"] = _heads(self._separator, self._point)[whole]
        left = digits
        for k, length in enumerate(groups):
            left -= length
            number = decimals // np.uint32(10**left)
            decimals = decimals - number * np.uint32(10**left)
            number[empty] = 10**length
            cells[f"{k}"] = _decimals(length)[number]
        self._cells.append(cells.view(np.uint8))

    def joined(self) -> bytes:
        """Return all lines, joined."""
        end = np.broadcast_to(np.frombuffer(b"\r\n", np.uint8), (len(self.doubtful), 2))
        return np.concatenate([*self._cells, end], axis=1).tobytes().translate(None, b"\0")


@cache
def _heads(before: str, point: str) -> NDArray[np.uint64]:
    """Return the bytes up to the decimal point: of 0 … 9999, of their negatives, and of an empty cell."""
    numbers = np.arange(_WHOLE_MAX)
    table = np.zeros((2, _WHOLE_MAX, _HEAD_BYTES), np.uint8)
    for place, power in enumerate((1000, 100, 10, 1)):
        shown = (numbers >= power) | (power == 1)
        table[..., 2 + place] = np.where(shown, ord("0") + numbers // power % 10, 0)
    table[1, :, 1] = ord("-")
    table[..., 6] = ord(point)
    table = np.concatenate([table.reshape(-1, _HEAD_BYTES), np.zeros((1, _HEAD_BYTES), np.uint8)])
    table[:, 0] = ord(before)
    return np.ascontiguousarray(table).view(np.uint64)[:, 0]


@cache
def _decimals(length: int) -> NDArray[np.uint32]:
    """Return the bytes of all groups of `length` decimals, and of an empty cell."""
    numbers = np.arange(10**length)
    table = np.zeros((10**length + 1, _GROUP), np.uint8)
    for place in range(length):
        table[:-1, place] = ord("0") + numbers // 10 ** (length - 1 - place) % 10
    return table.view(np.uint32)[:, 0]
