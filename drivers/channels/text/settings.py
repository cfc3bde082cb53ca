"""Rig-file settings of a text instrument: how it is reached, what it is asked, and where its values stand."""

import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Annotated, Literal, Self, TypeAlias

from pydantic import AfterValidator, Field, model_validator

from drivers.channels.device_time import TimeUnit
from drivers.channels.settings import ChannelSettings, SignalSettings
from drivers.lines.channel import TCP_PREFIX
from drivers.settings import LONGEST_PATH, Settings

VISA_PREFIX = "visa://"
ENDS = {"LF": b"\n", "CR": b"\r", "CRLF": b"\r\n"}
SEPARATORS = {"tab": "\t", "space": None}
"""Names of separators that cannot be written in a rig file. None means one or more spaces or tabs."""


def compiled(text: str) -> str:
    """Check that a text is a regular expression. Raise `ValueError` for pydantic."""
    try:
        re.compile(text)
    except re.error as error:
        raise ValueError(f"a regular expression is expected, but {error}") from error
    return text


def one_group(text: str) -> str:
    """Check that a text is a regular expression with exactly one group."""
    groups = re.compile(compiled(text)).groups
    if groups != 1:
        raise ValueError(
            f"one group (…) is expected, around the number, got {groups}; write (?:…) for other brackets"
        )
    return text


Words: TypeAlias = Annotated[str, Field(min_length=1, max_length=500)]
Pattern: TypeAlias = Annotated[Words, AfterValidator(compiled)]
ValuePattern: TypeAlias = Annotated[Words, AfterValidator(one_group)]
Column: TypeAlias = Annotated[int, Field(ge=1, le=256)]


class TextCheck(Settings):
    """A question, and a pattern that the whole answer must fit."""

    query: Words
    pattern: Pattern


class PlaceSettings(Settings):
    """The place of a number in a line: a pattern of the whole line, or a column. Default: the whole line."""

    pattern: ValuePattern | None = Field(
        default=None, description="regular expression of the whole line, with one group around the number"
    )
    column: Column | None = Field(default=None, description="column of the number, counted from 1")

    @model_validator(mode="after")
    def _one_place(self) -> Self:
        if self.pattern is not None and self.column is not None:
            raise ValueError("pattern and column contradict each other; remove one of them")
        return self


class TimeSettings(PlaceSettings):
    """The place of the device's own time in its lines."""

    unit: TimeUnit
    wraps_at: float | None = Field(
        default=None, gt=0.0, description="number at which the time begins at 0 again, such as 4294967296"
    )


class CounterSettings(PlaceSettings):
    """The place of a counter in the lines of a device that sends them by itself."""

    wraps_at: int | None = Field(
        default=None, gt=1, description="number at which the counter begins at 0 again, such as 65536"
    )


class TextSignalSettings(SignalSettings, PlaceSettings):
    """A signal, and the place of its value. `query` replaces the common query of the device."""

    query: Words | None = None


class TextChannelSettings(ChannelSettings):
    """Settings of a text instrument, the table `[channels.NAME]`."""

    signals: Mapping[str, TextSignalSettings] = Field(min_length=1, max_length=64)
    # path of a serial port, socket://host:port, visa://RESOURCE, or @name in a simulated rig
    address: str = Field(min_length=1, max_length=LONGEST_PATH)
    # of a serial port, also one that VISA opens
    baud: int = Field(default=9600, ge=50, le=4_000_000)
    data_bits: Literal[7, 8] = 8
    parity: Literal["N", "E", "O"] = "N"
    stop_bits: Literal[1, 2] = 1
    # the library as PyVISA names it: "@py", or the path of the maker's library
    visa_library: str = Field(default="@py", max_length=LONGEST_PATH)
    # how each message to the instrument ends
    line_end: Literal["LF", "CR", "CRLF"] = "LF"
    encoding: Literal["ascii", "latin-1", "utf-8"] = "ascii"
    echo: bool = False  # True if the instrument sends each query back before its answer
    # time for which the instrument is not ready after its port was opened, such as an Arduino that restarts
    start_s: float = Field(default=0.0, ge=0.0, le=30.0)
    # commands that are sent once, in this order, after the identification
    opening: list[Words] = Field(default_factory=list, max_length=100)
    identification: TextCheck | None = None
    # question for errors after the opening commands, with a pattern of the answer that means "no error"
    errors: TextCheck | None = None
    query: Words | None = None  # question for a sample
    stream: bool = False  # True if the instrument sends lines by itself
    # how often per second the instrument is asked, or sends a line
    rate_hz: float = Field(gt=0.0, le=100_000.0)
    reply_timeout_s: float = Field(default=0.5, gt=0.0, le=60.0)
    separator: str = Field(default=",", min_length=1, max_length=10)  # also "tab" or "space"
    decimal: Literal[".", ","] = "."
    columns: Column | None = None  # number of columns in each line. Default: the highest column that is used
    # texts that mean "no value". The numbers of SCPI, 9.9E37 and 9.91E37, always mean this.
    invalid: list[Words] = Field(default_factory=list, max_length=32)
    ignore: list[Pattern] = Field(default_factory=list, max_length=32)  # lines that are no answers
    time: TimeSettings | None = None
    counter: CounterSettings | None = None

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        mistakes = [*self._of_address(), *self._of_queries(), *self._of_columns()]
        if mistakes:
            raise ValueError("; ".join(mistakes))
        return self

    @property
    def is_visa(self) -> bool:
        """True if VISA opens the instrument."""
        return self.address.startswith(VISA_PREFIX)

    @property
    def longest_wait_s(self) -> float:
        """Longest wait for a line, in s: the reply timeout or the time between two lines of a slow stream."""
        return max(self.reply_timeout_s, 2.0 / self.rate_hz if self.stream else 0.0)

    @property
    def queries(self) -> dict[str, list[str]]:
        """The names of the signals in the answer to each query. A stream has one query, an empty text."""
        found: dict[str, list[str]] = {}
        for name, signal in self.signals.items():
            found.setdefault(signal.query or self.query or "", []).append(name)
        return found

    def _of_address(self) -> Iterator[str]:
        is_socket = self.address.startswith(TCP_PREFIX) or (self.is_visa and "ASRL" not in self.address)
        line = self.model_fields_set & {"baud", "data_bits", "parity", "stop_bits"}
        if is_socket and line:
            yield f"{', '.join(sorted(line))} belong to a serial port; remove them"
        if self.model_fields_set & {"visa_library"} and not self.is_visa:
            yield f"visa_library belongs to an address {VISA_PREFIX}RESOURCE; remove it"
        if self.is_visa and (self.stream or self.echo):
            yield "a stream and an echo need a serial port or socket://host:port as address"
        texts = [each.query for each in (self.identification, self.errors, *self.signals.values()) if each]
        for text in (*self.opening, self.query, *texts):
            try:
                (text or "").encode(self.encoding)
            except UnicodeEncodeError:
                yield f'{text!r} cannot be sent as {self.encoding}; set encoding = "utf-8" or "latin-1"'

    def _of_queries(self) -> Iterator[str]:
        own = [name for name, signal in self.signals.items() if signal.query is not None]
        if self.stream:
            if self.query is not None or own:
                yield "a stream needs no query; remove query, or stream"
            return
        if lacking := [name for name in self.signals if self.query is None and name not in own]:
            yield f"query is missing for {', '.join(lacking)}; add it, or stream = true"
        if self.counter is not None:
            yield "a counter belongs to a stream; remove it"
        if self.time is not None and len(self.queries) > 1:
            yield "the device's time belongs to one query for all signals; remove time, or the other queries"

    def _of_columns(self) -> Iterator[str]:
        if self.separator == "," == self.decimal:
            yield 'separator and decimal are both a comma; set separator = ";" or "tab" or "space"'
        if self.separator.strip() == "":
            yield 'a separator of blanks is written "space"'
        if self.decimal in self.separator:
            yield "the separator contains the decimal sign; change one of them"
        for places in self._places():
            taken = [(place.pattern, place.column) for place in places]
            if len(set(taken)) < len(taken):
                yield "two values have the same place in a line; give each its own column or pattern"
            if self.columns is not None:
                beyond = [place.column for place in places if (place.column or 0) > self.columns]
                if beyond:
                    yield f"column must be at most columns, {self.columns}, got {max(filter(None, beyond))}"

    def _places(self) -> Iterable[list[PlaceSettings]]:
        """The places of the numbers in each kind of line."""
        common: list[PlaceSettings] = [each for each in (self.time, self.counter) if each is not None]
        return [[*common, *(self.signals[name] for name in names)] for names in self.queries.values()]
