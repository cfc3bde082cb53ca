"""Round numbers beside an axis or a colour bar."""

from dataclasses import dataclass
from math import ceil, floor, log10

_LEAST_STEP, _MOST = 1e-4, 1e6
"""Numbers with a smaller step, and larger numbers, are written with a power of ten beside the unit."""
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


@dataclass(frozen=True)
class Ticks:
    """Numbers beside an axis."""

    values: list[float]
    texts: list[str]
    power: str = ""
    """The power of ten that all texts lack, such as "10⁻⁶ "; "" for none."""


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
