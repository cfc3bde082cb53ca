"""Live gauges as signals: for criteria, limits and control, and for the run file."""

from collections.abc import Sequence

import numpy as np

from drivers.interfaces import DeviceInfo
from drivers.signals import Signal
from rig.live.measuring import cause_number
from rig.live.values import CAUSES, LiveReading
from rig.protocol.live_table import LiveTable
from rig.recorder.records import ChannelsRecord, SignalRecord
from rig.samples import GAUGE_PREFIX, SignalReading, TimedSamples

RECORDED = "live_gauges"
"""Name of the channel device of the run file that has the values of the live gauges."""

LATENCY = "gauge_latency"
"""Signal of the run file: time from the middle of the exposure to the moment when the values were known."""

ALL, STD, CAUSE = "all", "std", "cause"
_LEAST, _MOST = -1.0, 1e6


def signals_of(table: LiveTable) -> tuple[Signal, ...]:
    """Return the signal of each gauge, "gauge.NAME": its strain where it is valid."""
    return tuple(Signal(f"{GAUGE_PREFIX}{name}", "1", _LEAST, _MOST) for name in table.names)


def signal_readings(table: LiveTable, readings: Sequence[LiveReading]) -> dict[str, SignalReading]:
    """Return what the signals of all gauges did in these readings, valid values only.

    A gauge without a valid value among them is missing.
    """
    found = {}
    for name in table.names:
        own = [(reading.time_s, reading.gauges[name].strain) for reading in readings if _valid(reading, name)]
        if own:
            times, strains = np.array(own, np.float64).T
            found[f"{GAUGE_PREFIX}{name}"] = SignalReading(strains, times, True, "1")
    return found


def channels_record(table: LiveTable) -> ChannelsRecord:
    """Return the description of the channel device of the run file; see `samples`."""
    signals: list[Signal] = []
    for signal in signals_of(table):
        signals += [
            signal,
            Signal(f"{signal.name}.{ALL}", "1", _LEAST, _MOST),
            Signal(f"{signal.name}.{STD}", "1", 0.0, _MOST),
            Signal(f"{signal.name}.{CAUSE}", "", 0.0, float(len(CAUSES))),
        ]
    signals.append(Signal(LATENCY, "s", 0.0, _MOST))
    return ChannelsRecord(
        DeviceInfo("offaxis", "live gauges", ""), tuple(SignalRecord(each) for each in signals)
    )


class LiveSamples:
    """Turns readings into samples for the run file, and numbers them. Their times are those of the exposures.

    Each gauge has four signals: ``gauge.NAME``, its strain where it is valid and NaN elsewhere;
    ``gauge.NAME.all``, its strain also where it is not valid, NaN if there is none; ``gauge.NAME.std``, the
    standard deviation of ``all``; and ``gauge.NAME.cause``, the place in `CAUSES` of the reason why it is not
    valid, 0 for a valid value.

    Parameters
    ----------
    table : LiveTable
    """

    def __init__(self, table: LiveTable) -> None:
        self._names = table.names
        self._next = 0

    def of(self, readings: Sequence[LiveReading]) -> TimedSamples | None:
        """Return the samples of readings, None without any."""
        if not readings:
            return None
        first, self._next = self._next, self._next + len(readings)
        return TimedSamples(
            np.array([self._row(reading) for reading in readings], np.float64),
            np.array([reading.time_s for reading in readings]),
            np.array([reading.time_std_s for reading in readings]),
            np.full(len(readings), np.nan),
            first,
        )

    def _row(self, reading: LiveReading) -> list[float]:
        row: list[float] = []
        for name in self._names:
            value = reading.gauges[name]
            valid = value.strain if _valid(reading, name) else np.nan
            row += [valid, value.strain, value.std if np.isfinite(value.std) else np.nan, cause_number(value)]
        return [*row, max(0.0, reading.known_s - reading.time_s)]


def _valid(reading: LiveReading, name: str) -> bool:
    value = reading.gauges[name]
    return value.valid and bool(np.isfinite(value.strain))
