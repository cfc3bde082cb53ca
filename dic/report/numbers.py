"""Numbers and dates as text for the report."""

from datetime import datetime

_DIGITS = 4
"""Decimals of a value whose standard deviation gives no number of decimals."""
_MOST_DIGITS = 6
"""A smaller standard deviation is written with an exponent."""
_ROUND = 9.95
"""Only a number below this limit is written as less than 10.0 when it is rounded to one decimal."""
_LEAST = 0.05
"""A number below this limit is 0.0 after rounding to one decimal."""


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

    The numbers have one decimal if the standard deviation is below 10 µε, else no decimals. A standard
    deviation that would be rounded to 0.0 has two significant digits instead.

    Examples
    --------
    >>> micro_with_std(-362.13, 0.44), micro_with_std(1234.5, 12.3), micro_with_std(0.02, 0.013)
    ('−362.1 ± 0.4', '1234 ± 12', '0.020 ± 0.013')
    """
    if std < _LEAST:
        return with_std(value, std)
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

    The standard deviation is rounded to two significant digits, and the value to as many decimals. A
    standard deviation that is exactly zero is "0", so that it cannot be taken for a small one.

    Examples
    --------
    >>> with_std(34.6473, 0.19294), with_std(-0.1, 0.0), with_std(1.0, float("nan"))
    ('34.65 ± 0.19', '−0.1000 ± 0', '1.0000 ± –')
    >>> with_std(0.33, 0.0000123), with_std(0.33, 1.23e-12)
    ('0.330000 ± 0.000012', '0.3300 ± 1.2e-12')
    """
    if not std > 0:
        return f"{_signed(value, _DIGITS)} ± {'–' if std != std else '0'}"
    # The exponent after rounding: 0.0996 is 0.10 with two digits.
    digits = max(0, 1 - int(f"{std:.1e}".partition("e")[2]))
    if digits > _MOST_DIGITS:
        return f"{_signed(value, _DIGITS)} ± {std:.1e}"
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


def direction_text(direction_deg: float) -> str:
    """Return the direction of a specimen as text."""
    return f"{direction_deg:g}° to the rolling direction"
