"""Numbers and dates as text for the report."""

import math
from datetime import datetime

_MOST_DIGITS = 4
_ROUND = 9.95
"""Only a number below this limit is written as less than 10.0 when it is rounded to one decimal."""


def micro(value: float) -> str:
    """Return a strain in µε as text without decimals. From 10 000 on, a thin space separates thousands.

    A NaN gives a dash.

    Examples
    --------
    >>> micro(-1234.6), micro(float("nan"))
    ('−1235', '–')
    """
    return _signed(value, 0)


def micro_with_std(value: float, std: float) -> str:
    """Return a strain in µε and its standard deviation as text.

    The numbers have one decimal if the standard deviation is below 10 µε, else no decimals.

    Examples
    --------
    >>> micro_with_std(-362.13, 0.44), micro_with_std(1234.5, 12.3)
    ('−362.1 ± 0.4', '1234 ± 12')
    """
    decimals = 1 if std < _ROUND else 0
    return f"{_signed(value, decimals)} ± {_signed(std, decimals)}"


def fixed(value: float, decimals: int) -> str:
    """Return a number as text with a fixed number of decimals. A NaN gives a dash.

    Examples
    --------
    >>> fixed(-0.001, 2), fixed(2.5, 1)
    ('0.00', '2.5')
    """
    return _signed(value, decimals)


def with_std(value: float, std: float) -> str:
    """Return a value and its standard deviation as text.

    The standard deviation is rounded to two digits, but to at most four decimals. The value is rounded to as
    many decimals as the standard deviation.

    Examples
    --------
    >>> with_std(34.6473, 0.19294), with_std(-0.1, 0.0), with_std(1.0, float("nan"))
    ('34.65 ± 0.19', '−0.1000 ± 0.0000', '1.0000 ± –')
    """
    digits = max(0, 1 - math.floor(math.log10(std))) if std > 0 else _MOST_DIGITS
    digits = min(digits, _MOST_DIGITS)
    return f"{_signed(value, digits)} ± {_signed(std, digits)}"


def date(iso: str) -> str:
    """Return an ISO 8601 date and time without the letter T and without fractions of a second.

    Any other text is returned unchanged.

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
        # Separate thousands by a thin non-breaking space, because many readers take a comma for a decimal
        # sign.
        text = f"{abs(value):,.{decimals}f}".replace(",", "\u202f")
    return f"−{text}" if value < 0 and float(text.replace("\u202f", "")) else text
