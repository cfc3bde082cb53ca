"""Round numbers beside an axis or a colour bar."""

from dataclasses import dataclass
from math import ceil, floor, log10

_LEAST_STEP, _MOST = 1e-4, 1e6
"""Numbers with a smaller step, and larger numbers, are written with a power of ten beside the unit."""
_MOST_NUMBERS = 8
_LETTER_MM = 0.225
"""Width of a digit of 1 pt."""
_FREE_LETTERS, _UPRIGHT_LETTERS = 1.5, 6
"""Space between numbers side by side, and of numbers above one another, in widths of a digit."""
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


@dataclass(frozen=True)
class Ticks:
    """Numbers beside an axis."""

    values: list[float]
    texts: list[str]
    power: str = ""
    """The power of ten that all texts lack, such as "10⁻⁶ "; "" for none."""


def fitting_ticks(
    low: float, high: float, length_mm: float, size_pt: float, *, beside: bool = False
) -> Ticks:
    """Return round numbers that have room at an axis of a given length, in letters of a given size.

    `beside`: True for numbers beside an upright axis, whose width does not matter.
    """
    for most in range(_MOST_NUMBERS, 1, -1):
        ticks = round_ticks(low, high, most)
        letters = _UPRIGHT_LETTERS if beside else max(map(len, ticks.texts), default=0) + _FREE_LETTERS
        if len(ticks.values) < 2:
            continue
        spacing_mm = length_mm * abs((ticks.values[1] - ticks.values[0]) / (high - low))
        if letters * _LETTER_MM * size_pt <= spacing_mm:
            return ticks
    return Ticks(ticks.values[:1], ticks.texts[:1], ticks.power)


def round_ticks(low: float, high: float, most: int) -> Ticks:
    """Return at most `most` numbers from `low` to `high`, at multiples of 1, 2 or 5 times a power of ten.

    At least one number is between the ends if `most` is at least 2.
    """
    least, greatest = min(low, high), max(low, high)
    exponent = floor(log10((greatest - least) / max(most, 1)))
    steps = (factor * 10.0 ** (exponent + further) for further in (0, 1) for factor in (1, 2, 5))
    for step in steps:
        slack = 1e-9 * step
        first, last = ceil((least - slack) / step), floor((greatest + slack) / step)
        if last - first + 1 <= most:
            break
    multiples = range(first, last + 1)
    shift = 3 * floor(log10(step) / 3) if step < _LEAST_STEP or greatest >= _MOST else 0
    decimals = max(0, shift - floor(log10(step) + 1e-9))
    texts = [f"{k * step / 10.0**shift:z.{decimals}f}".replace("-", "−") for k in multiples]
    power = f"10{str(shift).translate(_RAISED)} " if shift else ""
    return Ticks([k * step for k in multiples], texts, power)
