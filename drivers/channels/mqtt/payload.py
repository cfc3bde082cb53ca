"""Read numbers and times out of the messages of publishers."""

import json
import math
from collections.abc import Sequence
from datetime import datetime
from typing import Any

from drivers.channels.device_time import SECONDS
from drivers.channels.mqtt.settings import MqttSignalSettings, MqttTimeSettings
from drivers.channels.numbers import number_in

LONGEST = 65_536
"""Longest message in bytes that is read."""
_SHOWN_MAX = 60


class Payload:
    """Reads the numbers of some signals, and the time if there is one, out of the messages of a topic.

    `invalid` are texts that mean "no value".
    """

    def __init__(
        self, signals: Sequence[MqttSignalSettings], time: MqttTimeSettings | None, invalid: Sequence[str]
    ) -> None:
        self._paths = [signal.json_path for signal in signals]
        self._time = time
        self._invalid = frozenset(invalid)

    def read(self, message: bytes) -> tuple[list[float], float]:
        """Return the numbers and the publisher's time in s, which is NaN if the messages have none.

        A number is NaN if the publisher has no value. Raise `ValueError` if a message has another form.
        """
        if len(message) > LONGEST:
            raise ValueError(f"a message of {len(message)} bytes, which is too long")
        text = message.decode(errors="backslashreplace").strip()
        content = self._content(text)
        values = [
            self._number(text if path is None else _at(content, path, text), path, text)
            for path in self._paths
        ]
        return values, math.nan if self._time is None else self._seconds(content, text)

    def _content(self, text: str) -> Any:
        if self._time is None and all(path is None for path in self._paths):
            return None
        try:
            return json.loads(text)
        except (ValueError, RecursionError) as error:
            raise ValueError(f"{_shown(text)}, which is no JSON") from error

    def _number(self, value: object, path: str | None, text: str) -> float:
        if value is None or (isinstance(value, str) and value.strip() in self._invalid):
            return math.nan
        number = _number_of(value)
        if number is None:
            where = "" if path is None else f" at {path!r}"
            raise ValueError(f"{_shown(text)} instead of a number{where}")
        return number

    def _seconds(self, content: object, text: str) -> float:
        assert self._time is not None
        path, unit = self._time.json_path, self._time.unit
        value = _at(content, path, text)
        if unit == "iso" and isinstance(value, str):
            try:
                moment = datetime.fromisoformat(value)
            except ValueError as error:
                raise ValueError(f"{_shown(text)} without a date and time at {path!r}") from error
            if moment.tzinfo is None:
                raise ValueError(f"{_shown(text)} with a time at {path!r} that has no time zone")
            return moment.timestamp()
        number = None if unit == "iso" else _number_of(value)
        if number is None or unit == "iso":
            raise ValueError(f"{_shown(text)} without a time at {path!r}")
        return number * SECONDS[unit]


def _at(content: Any, path: str, text: str) -> object:
    """Return the value at a path such as ``sensors.0.value``. Raise `ValueError` if there is none."""
    for key in path.split("."):
        try:
            content = content[int(key)] if isinstance(content, list) else content[key]
        except (KeyError, IndexError, ValueError, TypeError) as error:
            raise ValueError(f"{_shown(text)} without {path!r}") from error
    return content


def _number_of(value: object) -> float | None:
    if isinstance(value, str):
        return number_in(value)
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        number = float(value)
    except OverflowError:
        return None
    return number if math.isfinite(number) else None


def _shown(text: str) -> str:
    return repr(text if len(text) <= _SHOWN_MAX else f"{text[:_SHOWN_MAX]}…")
