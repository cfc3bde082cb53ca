"""Numbers as text: which mark stands before the decimals, and which one between thousands.

A file is written by one program with one decimal mark. The comma in 1,059 may be either; the marks in 0,25
and 1,234.5 are certain, and then those of every other cell are certain, too.
"""

import re
from collections.abc import Iterable, Sequence

import numpy as np

from dic.typing import Float

_SPACES = " '’\u00a0\u2009\u202f"
"""Signs between thousands that never stand before decimals."""
_EXPONENT = r"(?:[eE][+-]?\d+)?"
_PLAIN = re.compile(rf"[+-]?(?:\d+(?:[.,]\d*)?|[.,]\d+){_EXPONENT}", re.ASCII)
_GROUPED = re.compile(rf"[+-]?[1-9]\d{{0,2}}([.,{_SPACES}])\d{{3}}(?:\1\d{{3}})*(?:(?!\1)[.,]\d*)?", re.ASCII)
_INDIAN = re.compile(r"[+-]?[1-9]\d?(,\d{2})+,\d{3}(?:\.\d*)?", re.ASCII)
"""Groups of two digits before the last one, as in 1,12,927."""
_ONE_GROUP = re.compile(r"[+-]?[1-9]\d{0,2}[.,]\d{3}", re.ASCII)
_UP_TO_999 = re.compile(r"[+-]?\d{1,3}", re.ASCII)
_FOUR_DIGITS = re.compile(r"[+-]?\d{4,}", re.ASCII)


class Ambiguous(Exception):
    """The marks of a column's numbers contradict each other, or may mean two things.

    The arguments are the expected result, the actual result, and the remedy.
    """


def is_number(text: str) -> bool:
    """Return whether a text is one number, with or without marks between thousands."""
    return bool(_PLAIN.fullmatch(text) or _GROUPED.fullmatch(text) or _INDIAN.fullmatch(text))


def certain_decimal_marks(texts: Iterable[str]) -> set[str]:
    """Return the marks that certainly stand before decimals in these numbers."""
    found = set()
    for text in texts:
        last = max(text.rfind("."), text.rfind(","))
        if last < 0 or _ONE_GROUP.fullmatch(text):
            continue
        if _INDIAN.fullmatch(text):
            found |= {"."} & set(text)
            continue
        grouped = _GROUPED.fullmatch(text)
        if grouped is None or text[last] != grouped[1]:
            found.add(text[last])
    return found


def parse(texts: Sequence[str], elsewhere: set[str]) -> Float:
    """Return the numbers of a column, and NaN for an empty text.

    `texts`: texts for which `is_number` is true, or empty ones. `elsewhere`: the certain decimal marks of the
    file's other columns.

    Raises `Ambiguous` if it is not certain what the marks mean.
    """
    filled = [text for text in texts if text]
    own = certain_decimal_marks(filled)
    between = {
        match[1] for text in filled if not _ONE_GROUP.fullmatch(text) and (match := _GROUPED.fullmatch(text))
    }
    between |= {"," for text in filled if _INDIAN.fullmatch(text)}
    open_marks = {text[-4] for text in filled if _ONE_GROUP.fullmatch(text)} - own - between
    if open_marks and not own and not between:
        if len(elsewhere) == 1 and not open_marks & elsewhere:
            between = open_marks
        elif not elsewhere:
            _require_certain(filled)
    elif own:
        between |= open_marks
    decimals = own | (open_marks - between)
    if len(decimals) > 1 or decimals & between or (between and any(map(_FOUR_DIGITS.fullmatch, filled))):
        raise Ambiguous(
            "a decimal point or a decimal comma",
            "both"
            if len(decimals) > 1 or decimals & between
            else "marks between thousands in a part of the numbers",
            "export the file without thousands separators",
        )
    drop = str.maketrans(dict.fromkeys((*between, *_SPACES), "") | dict.fromkeys(decimals, "."))
    return np.array([float(text.translate(drop)) if text else np.nan for text in texts])


def _require_certain(filled: Sequence[str]) -> None:
    """Raise an error if points or commas may separate thousands, as in 999 followed by 1,001.

    With a decimal mark, this combination does not occur. Machines write a fixed number of decimals, so no
    number is whole; or they drop zeros at the end, so the number of decimals varies. Numbers that all have a
    comma and three digits behind it may be either, unless one of them is below 1. A point in all of them is
    usual before decimals and rare between thousands.
    """
    marked = [text for text in filled if "," in text or "." in text]
    whole = [text for text in filled if "," not in text and "." not in text]
    open_to_both = whole or any("," in text for text in marked)
    if (
        marked
        and open_to_both
        and all(map(_ONE_GROUP.fullmatch, marked))
        and all(map(_UP_TO_999.fullmatch, whole))
    ):
        may_be = marked[0].replace(",", "").replace(".", "")
        got = f"{whole[0]!r} and {marked[0]!r}" if whole else f"{marked[0]!r} and no number below 1"
        raise Ambiguous(
            "numbers whose decimals are certain",
            f"{got}, which may be {may_be}",
            "export the file without thousands separators, or with another number of decimals than three",
        )
