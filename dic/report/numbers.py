"""Numbers and dates as text for the report."""

import math
from datetime import datetime

_MOST_DIGITS = 4
_ROUND = 9.95
"""Smaller numbers are less than 10.0 when rounded to one decimal."""


def micro(value: float) -> str:
    """Return a strain in µε without decimals, with a thousands separator from 10 000; a dash for NaN.

    Examples
    --------
    >>> micro(-1234.6), micro(float("nan"))
    ('−1235', '–')
    """
    return _signed(value, 0)


def micro_with_std(value: float, std: float) -> str:
    """Return a strain in µε and its standard deviation; with one decimal if the latter is below 10 µε.

    Examples
    --------
    >>> micro_with_std(-362.13, 0.44), micro_with_std(1234.5, 12.3)
    ('−362.1 ± 0.4', '1234 ± 12')
    """
    decimals = 1 if std < _ROUND else 0
    return f"{_signed(value, decimals)} ± {_signed(std, decimals)}"


def fixed(value: float, decimals: int) -> str:
    """Return a number with a fixed number of decimals; a dash for NaN.

    Examples
    --------
    >>> fixed(-0.001, 2), fixed(2.5, 1)
    ('0.00', '2.5')
    """
    return _signed(value, decimals)


def with_std(value: float, std: float) -> str:
    """Return a value and its standard deviation, rounded to two digits but at most four decimals.

    Examples
    --------
    >>> with_std(34.6473, 0.19294), with_std(-0.1, 0.0), with_std(1.0, float("nan"))
    ('34.65 ± 0.19', '−0.1000 ± 0.0000', '1.0000 ± –')
    """
    digits = max(0, 1 - math.floor(math.log10(std))) if std > 0 else _MOST_DIGITS
    digits = min(digits, _MOST_DIGITS)
    return f"{_signed(value, digits)} ± {_signed(std, digits)}"


def date(iso: str) -> str:
    """Return an ISO 8601 date and time without T and fractions; any other text unchanged.

    Examples
    --------
    >>> date("2026-01-01T08:00:00+00:00"), date("")
    ('2026-01-01 08:00:00 UTC', '')
    """
    try:
        return f"{datetime.fromisoformat(iso):%Y-%m-%d %H:%M:%S %Z}".rstrip()
    except ValueError:
        return iso


def _signed(value: float, decimals: int) -> str:
    if value != value:
        return "–"
    text = f"{abs(value):.{decimals}f}"
    if abs(value) >= 10_000:
        # A thin non-breaking space: many readers would take a comma for a decimal sign.
        text = f"{abs(value):,.{decimals}f}".replace(",", "\u202f")
    return f"−{text}" if value < 0 and float(text.replace("\u202f", "")) else text
