"""Read TOML files that people write, and find unknown keys and values of a wrong type."""

import tomllib
from collections.abc import Iterator, Mapping
from datetime import date, datetime
from typing import Any

from dic.errors import MeasurementError, is_number
from dic.files.reading import read_text
from dic.typing import PathLike

TEXT, NUMBER, NUMBERS = "a line of text", "a number", "a list of numbers"
DATE = 'a date such as "2026-03-02", or a date and time of ISO 8601'
"""The kinds of values that a key may have, named as in error messages."""
_MOST_CHARACTERS = 500
_MOST_REASON = 200


def read_toml(path: PathLike, error: type[MeasurementError], step: str, remedy: str) -> dict[str, Any]:
    """Return the content of a TOML file.

    `error`: class of the error to raise. `step`, `remedy`: the step that needs the file, and an example of
    what to write into it.

    Raises `MeasurementError` if the file cannot be read, or is not TOML.
    """
    source = str(path)
    try:
        return tomllib.loads(read_text(path))
    except OSError as reason:
        got = reason.strerror or str(reason)
        raise error(source, step, "a TOML file", got, "name another file") from reason
    except (ValueError, RecursionError) as reason:
        got = f"one that cannot be understood ({' '.join(str(reason).split())[:_MOST_REASON]})"
        raise error(source, step, "a TOML file", got, remedy) from reason


def wrong_values(
    place: str,
    table: Mapping[str, Any],
    known: Mapping[str, str],
    error: type[MeasurementError],
    kind: str = "",
) -> Iterator[MeasurementError]:
    """Yield an error for each unknown key, and for each value of a wrong type.

    `place`: the file and the table, for messages. `table`: keys and values of the table in the file. `known`:
    the kind of value of each known key: `TEXT`, `DATE`, `NUMBER` or `NUMBERS`. `error`: class of the errors.
    `kind`: description of the table's subject, such as "a result file", for messages.
    """
    for key, value in table.items():
        if key not in known:
            what = f"keys of {kind}" if kind else "keys"
            yield error(place, what, f"one of {', '.join(known)}", repr(key)[:80], "correct or remove it")
        elif not is_of_kind(value, known[key]):
            yield error(place, key, known[key], repr(value)[:80], "correct the value")


def is_of_kind(value: object, kind: str) -> bool:
    """Return True if a value is a line of printable text, a date, a number of a usual size, or a list.

    A date is a date of TOML, or a text in the form of ISO 8601.
    """
    if kind == TEXT:
        return isinstance(value, str) and 0 < len(value) <= _MOST_CHARACTERS and value.isprintable()
    if kind == DATE:
        return _is_date(value)
    if kind == NUMBERS:
        return isinstance(value, list) and len(value) > 0 and all(is_of_kind(one, NUMBER) for one in value)
    return is_number(value) and abs(value) < 1e300  # type: ignore[arg-type]


def _is_date(value: object) -> bool:
    if isinstance(value, str):
        try:
            datetime.fromisoformat(value)
        except ValueError:
            return False
    return isinstance(value, str | date)
