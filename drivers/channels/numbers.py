"""Numbers in the texts of devices."""

import math
import re

_NUMBER = re.compile(r"[-+]? *(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", re.ASCII)


def number_in(text: str, decimal: str = ".") -> float | None:
    """Return the number in a text, or None if the text is no finite number.

    Python's `float` also accepts other texts, such as ``1_000`` and ``nan``. `decimal` is the decimal sign. A
    sign may be followed by blanks, as indicators show it.
    """
    if decimal == ",":
        if "." in text:
            return None
        text = text.replace(",", ".")
    if _NUMBER.fullmatch(text.strip()) is None:
        return None
    number = float(text.replace(" ", ""))
    return number if math.isfinite(number) else None
