"""The samples of a run's measured channels as a table, with the time at which each quantity had its value."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import groupby
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from dic.errors import RunFileError
from dic.results.csv import CsvTable, new_table
from dic.runfile.reader import RunFile
from dic.runfile.schema import CHANNELS_GROUP, value_of
from dic.typing import Float, PathLike

TIME_COLUMNS = ("time_s", "time_std_s")
_TIME_DIGITS = 6
_BLOCK = 10_000


@dataclass(frozen=True)
class ChannelSummary:
    """One measured channel of a run.

    Attributes
    ----------
    device, signal, unit : str
    samples, lost : int
        Number of samples, and of lost ones between them.
    rate_hz : float
        Samples per second in the mean; NaN for less than two.
    least, greatest : float
        Smallest and greatest value; NaN without a valid one.
    delay_s, delay_std_s : float
        Delay of the values, which the times in a table do not contain, and its standard deviation.
    """

    device: str
    signal: str
    unit: str
    samples: int
    lost: int
    rate_hz: float
    least: float
    greatest: float
    delay_s: float
    delay_std_s: float

    def as_dict(self) -> dict[str, Any]:
        """Return the values by name, None for NaN."""
        return {key: None if value != value else value for key, value in asdict(self).items()}


class Delayed(Protocol):
    """Interface of what is known about a signal: its unit, its delay and the delay's standard deviation."""

    @property
    def unit(self) -> str:
        """The unit of the values."""

    @property
    def delay_s(self) -> float:
        """Time in s by which the values are later than the quantity."""

    @property
    def delay_std_s(self) -> float:
        """Standard deviation of the delay."""


class ChannelRows:
    """Makes lines of a table from blocks of samples.

    Signals of one device whose delays differ had their values at different times, so they are in different
    lines.

    Parameters
    ----------
    devices : mapping of str to (mapping of str to Delayed)
        The signals of each device in the order of their columns.
    """

    def __init__(self, devices: Mapping[str, Mapping[str, Delayed]]) -> None:
        self._devices = devices
        names = [(name, known.unit) for signals in devices.values() for name, known in signals.items()]
        self.heading = [*TIME_COLUMNS, *(f"{name} [{unit}]" for name, unit in names)]
        self._column = {name: k for k, (name, _) in enumerate(names)}

    def blocks(self, device: str, time_s: Float, time_std_s: Float, values: Float) -> Iterator[NDArray[Any]]:
        """Yield arrays of shape (n, 2 + signals) with times, their standard deviations, and values or NaN.

        `time_s` and `time_std_s` (n,) are those of the samples, `values` (n, signals of the device).
        """
        signals = list(self._devices[device].items())

        def delay(k: int) -> tuple[float, float]:
            return signals[k][1].delay_s, signals[k][1].delay_std_s

        for (delay_s, std_s), columns in groupby(sorted(range(len(signals)), key=delay), key=delay):
            block = np.full((len(time_s), len(self.heading)), np.nan)
            block[:, 0], block[:, 1] = time_s - delay_s, np.hypot(time_std_s, std_s)
            for k in columns:
                block[:, 2 + self._column[signals[k][0]]] = values[:, k]
            yield block


class ChannelTable:
    """Writes samples as CSV as they come, to an open text file whose lines end as they are written.

    `devices` are those of `ChannelRows`.
    """

    def __init__(self, file: Any, devices: Mapping[str, Mapping[str, Delayed]]) -> None:
        self._rows = ChannelRows(devices)
        self._table = CsvTable(file, decimal_comma=False)
        self._table.write(self._rows.heading)

    @staticmethod
    def encoding(devices: Mapping[str, Mapping[str, Delayed]]) -> str:
        """Return the encoding of the file. Text beyond ASCII needs a byte order mark for spreadsheets."""
        heading = ChannelRows(devices).heading
        return "utf-8" if all(title.isascii() for title in heading) else "utf-8-sig"

    def add(self, device: str, time_s: Float, time_std_s: Float, values: Float) -> None:
        """Write samples, as for `ChannelRows.blocks`."""
        for block in self._rows.blocks(device, time_s, time_std_s, values):
            _write_lines(self._table, block)


def _write_lines(table: CsvTable, block: NDArray[Any]) -> None:
    """Write the lines of a block of `ChannelRows`; a value that is missing or invalid is an empty cell."""
    comma = table.decimal_comma
    for time_s, std_s, *values in block.tolist():
        cells = ["" if value != value else f"{value:.10g}" for value in values]
        times = [table.number(time_s, _TIME_DIGITS), table.number(std_s, _TIME_DIGITS)]
        table.write([*times, *(cell.replace(".", ",") if comma else cell for cell in cells)])


def channel_summaries(path: PathLike) -> list[ChannelSummary]:
    """Return what a run file says about its measured channels, in the order of the file.

    Raise `RunFileError` if the file cannot be read.
    """
    with RunFile(path) as run:
        return [each for device in run.channels for each in _summaries(run, device)]


def write_channels(
    path: PathLike, table_path: PathLike, *, signals: Sequence[str] = (), decimal_comma: bool = False
) -> int:
    """Write the samples of the channels of a run as CSV, sorted by their times. Return the number of lines.

    Parameters
    ----------
    path : path
        A run file.
    table_path : path
        The table; an existing one is replaced.
    signals : sequence of str, optional
        Names of the signals. The default is all.
    decimal_comma : bool
        True for numbers with a decimal comma, and semicolons between the cells.

    Raises
    ------
    RunFileError
        If the file cannot be read, has no channels, or does not have one of the signals.
    """
    with RunFile(path) as run:
        devices = _chosen(run, signals)
        rows = ChannelRows(devices)
        blocks = [block for device in devices for block in _blocks(run, rows, device, devices[device])]
    whole = np.concatenate(blocks)
    whole = whole[np.argsort(whole[:, 0], kind="stable")]
    only_ascii = all(title.isascii() for title in rows.heading)
    with new_table(table_path, decimal_comma=decimal_comma, only_ascii=only_ascii) as table:
        table.write(rows.heading)
        for first in range(0, len(whole), _BLOCK):
            _write_lines(table, whole[first : first + _BLOCK])
    return len(whole)


def _summaries(run: RunFile, device: str) -> Iterator[ChannelSummary]:
    columns = run.columns(f"{CHANNELS_GROUP}/{device}")
    count, times_s = len(columns["number"]), columns["time_s"]
    steps = np.diff(columns["number"])
    span_s = float(times_s[-1] - times_s[0]) if count else 0.0
    rate_hz = (count - 1) / span_s if span_s > 0.0 else math.nan
    lost = int((steps[steps > 1] - 1).sum())
    for name, known in run.channels[device].items():
        values = columns[value_of(name)]
        valid = values[np.isfinite(values)]
        least, greatest = (float(valid.min()), float(valid.max())) if len(valid) else (math.nan, math.nan)
        delay = known.delay_s, known.delay_std_s
        yield ChannelSummary(device, name, known.unit, count, lost, rate_hz, least, greatest, *delay)


def _chosen(run: RunFile, signals: Iterable[str]) -> dict[str, dict[str, Any]]:
    known = {name: device for device, each in run.channels.items() for name in each}
    wanted = [name.removeprefix("channels.") for name in signals] or list(known)
    unknown = [name for name in wanted if name not in known]
    if unknown or not known:
        raise RunFileError(
            str(run.path),
            "read channels",
            f"the channels {', '.join(unknown)}" if unknown else "measured channels",
            ", ".join(known) or "a run without channels",
            "correct the name" if known else "name a run of a rig with [channels]",
        )
    return {
        device: {name: known for name, known in each.items() if name in wanted}
        for device, each in run.channels.items()
        if set(each) & set(wanted)
    }


def _blocks(run: RunFile, rows: ChannelRows, device: str, signals: Iterable[str]) -> Iterator[NDArray[Any]]:
    columns = run.columns(f"{CHANNELS_GROUP}/{device}")
    values = np.stack([columns[value_of(name)] for name in signals], axis=1)
    yield from rows.blocks(device, columns["time_s"], columns["time_std_s"], values)
