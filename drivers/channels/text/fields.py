"""Read numbers out of a line of text."""

import math
import re
from collections.abc import Callable, Sequence

from drivers.channels.numbers import number_in
from drivers.channels.text.settings import SEPARATORS, PlaceSettings, TextChannelSettings

SCPI_INVALID = ("9.9E37", "-9.9E37", "9.91E37")
"""Numbers that mean infinity, its negative, and no number (SCPI 1999.0, Volume 1, 7.2.1.4 and 7.2.1.5)."""


class LineFields:
    """Reads the numbers at some places of a line.

    Parameters
    ----------
    settings : TextChannelSettings
        The instrument, with separator, decimal sign and texts that mean "no value".
    places : sequence of PlaceSettings
        The places of the numbers, in the order of the results.
    """

    def __init__(self, settings: TextChannelSettings, places: Sequence[PlaceSettings]) -> None:
        self._separator = SEPARATORS.get(settings.separator, settings.separator)
        self._decimal = settings.decimal
        self._count = settings.columns or max((place.column or 0 for place in places), default=0)
        self._invalid_texts = {text.strip() for text in settings.invalid}
        self._invalid_numbers = {
            number for text in (*SCPI_INVALID, *settings.invalid) if (number := number_in(text)) is not None
        }
        self._texts = [self._text_at(place) for place in places]

    def read(self, line: str) -> list[float]:
        """Return the numbers. NaN means that the instrument has no value.

        Raise `ValueError` if the line does not have the expected form.
        """
        if line in self._invalid_texts:
            return [math.nan] * len(self._texts)
        return [self._value(text(line), line) for text in self._texts]

    def _text_at(self, place: PlaceSettings) -> Callable[[str], str]:
        """Return the function that returns the text at a place of a line."""
        if place.pattern is not None:
            pattern = re.compile(place.pattern)

            def matched(line: str) -> str:
                found = pattern.fullmatch(line)
                if found is None or found[1] is None:
                    raise ValueError(f"{line!r}, which does not fit the pattern {pattern.pattern!r}")
                return found[1]

            return matched
        column = place.column
        if column is None:
            return lambda line: line

        def of_column(line: str) -> str:
            texts = line.split(self._separator)
            if len(texts) != self._count:
                raise ValueError(f"{line!r} with {len(texts)} columns instead of {self._count}")
            return texts[column - 1]

        return of_column

    def _value(self, text: str, line: str) -> float:
        text = text.strip()
        if text in self._invalid_texts:
            return math.nan
        number = number_in(text, self._decimal)
        if number is None:
            raise ValueError(f"{line!r} with {text!r} instead of a number")
        return math.nan if number in self._invalid_numbers else number
