"""Read the measured channels of a rig without a run, and tell their present values."""

import threading
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from dic.derived import ChannelTable
from drivers.signals import Signal
from rig.channels.run_channels import RunChannels
from rig.commands.check_channels import noise_of, rate_of
from rig.devices import Rig
from rig.errors import RigError
from rig.rigfile import RigFile
from rig.samples import TimedSamples

WINDOW_S = 2.0
"""Noise and rate are those of the samples of this time in s, or of the newest few of a slow device."""
_LEAST_SAMPLES = 20
_POLL_S = 0.1


def only_channels(rig_file: RigFile) -> RigFile:
    """Return the rig with nothing but its channels. Raise `RigError` if it has none."""
    if not rig_file.channels:
        raise RigError(str(rig_file.path), "a rig with tables [channels.NAME]", "none", "add them")
    nothing: dict[str, Any] = {"cameras": {}, "interlocks": {}, "triggers": {}, "measured_load": None}
    return replace(rig_file, stage=None, load_frame=None, **nothing)


@dataclass(frozen=True)
class ChannelNow:
    """What is known about a signal now. Values that are unknown are NaN.

    `value`, `noise`, `low` and `high` are in `unit`; `time_std_s` is the standard deviation of the time of
    the newest sample on the rig's clock, without that of the signal's delay.
    """

    device: str
    signal: Signal
    value: float
    noise: float
    rate_hz: float
    asked_hz: float
    samples: int
    lost: int
    time_std_s: float

    @property
    def is_good(self) -> bool:
        """True if the value is in its range, and no sample was lost."""
        return self.signal.low <= self.value <= self.signal.high and self.lost == 0

    def line(self, width: int, *, whole: bool = True) -> str:
        """Return the numbers as a line of text, with the range if `whole`.

        The name is filled up to a width.
        """
        signal = self.signal
        outside = "" if signal.low <= self.value <= signal.high else " OUT OF RANGE"
        rate = f"{self.rate_hz:.4g}" + (f" of {self.asked_hz:g}" if self.asked_hz else "") + " per s"
        return (
            f"{signal.name:{width}} {self.value:12.6g} {signal.unit}{outside}, noise {self.noise:.3g}, "
            + (f"range {signal.low:g} to {signal.high:g}, " if whole else "")
            + f"{rate}, {self.lost} lost, time ± {1e3 * self.time_std_s:.2g} ms"
        )

    def as_dict(self) -> dict[str, Any]:
        """Return the numbers as a table for JSON, None for those that are unknown."""
        numbers = {
            "value": self.value,
            "noise": self.noise,
            "rate_hz": self.rate_hz,
            "asked_hz": self.asked_hz,
            "time_std_s": self.time_std_s,
        }
        return {
            "device": self.device,
            "signal": self.signal.name,
            "unit": self.signal.unit,
            **{key: value if np.isfinite(value) else None for key, value in numbers.items()},
            "range": [self.signal.low, self.signal.high],
            "delay_s": self.signal.delay_s,
            "delay_std_s": self.signal.delay_std_s,
            "samples": self.samples,
            "lost": self.lost,
        }


@dataclass
class _Recent:
    """The newest samples of a device, in blocks, and its numbers since the beginning."""

    blocks: deque[TimedSamples] = field(default_factory=deque)
    samples: int = 0

    def add(self, timed: TimedSamples) -> None:
        self.blocks.append(timed)
        self.samples += len(timed.values)
        kept = sum(len(each.values) for each in self.blocks)
        newest_s = timed.time_s[-1]
        while kept - len(oldest := self.blocks[0].values) >= _LEAST_SAMPLES and (
            self.blocks[0].time_s[-1] < newest_s - WINDOW_S
        ):
            kept -= len(oldest)
            self.blocks.popleft()


class ChannelWatch:
    """Reads all channels of a rig in a `with` block of the method `reading`.

    `table` receives all samples as CSV; None keeps none.
    """

    def __init__(self, rig: Rig, table: Path | None = None) -> None:
        self._rig = rig
        self._lock = threading.Lock()
        self._recent = {name: _Recent() for name in rig.channels}
        self._signals = {
            name: {each.name: each for each in device.signals} for name, device in rig.channels.items()
        }
        self._path = table
        self._table: ChannelTable | None = None
        self._failure: OSError | None = None
        self._channels = RunChannels(rig.channels, rig.clock, self._record, any_value=True)

    @contextmanager
    def reading(self) -> Iterator[None]:
        """Read the channels until the end of the block. Raise `DeviceError` if one gives no sample."""
        encoding = ChannelTable.encoding(self._signals)
        file = nullcontext() if self._path is None else self._path.open("w", newline="", encoding=encoding)
        with self._rig.clock.activity(), file as opened:
            if opened is not None:
                self._table = ChannelTable(opened, self._signals)
            try:
                self._channels.begin()
                while not self._channels.are_ready:
                    self._rig.clock.sleep(_POLL_S)
                yield
            finally:
                self._rig.lost.update(self._channels.end())

    def wait(self, seconds: float) -> None:
        """Read for some time. Raise `DeviceError` if a device fails."""
        end_s = self._rig.clock.now_s() + seconds
        while (left_s := end_s - self._rig.clock.now_s()) > 0.0:
            self._rig.clock.sleep(min(_POLL_S, left_s))
            self._channels.read()
            self._require_table()

    def now(self) -> list[ChannelNow]:
        """Return the present numbers of all signals, in the order of the rig file."""
        found = []
        with self._lock:
            for name, device in self._rig.channels.items():
                recent, (_, lost) = self._recent[name], self._channels.counts[name]
                if not recent.blocks:
                    continue
                values = np.concatenate([each.values for each in recent.blocks])
                times_s = np.concatenate([each.time_s for each in recent.blocks])
                of_all = rate_of(times_s), device.rate_hz, recent.samples, lost
                time_std_s = float(recent.blocks[-1].time_std_s[-1])
                found += [
                    ChannelNow(
                        name,
                        signal,
                        float(values[-1, k]),
                        noise_of(times_s, values[:, k]),
                        *of_all,
                        time_std_s,
                    )
                    for k, signal in enumerate(device.signals)
                ]
        return found

    def _require_table(self) -> None:
        if (error := self._failure) is not None:
            raise RigError(
                str(self._path), "a table that can be written", error.strerror or str(error), "free the disk"
            ) from error

    def _record(self, name: str, timed: TimedSamples) -> None:
        """Keep samples. On the thread of the device."""
        with self._lock:
            self._recent[name].add(timed)
            if self._table is None or self._failure is not None:
                return
            try:
                self._table.add(name, timed.time_s, timed.time_std_s, timed.values)
            except OSError as error:
                self._failure = error


def lines_of(found: Sequence[ChannelNow], *, whole: bool = True) -> list[str]:
    """Return a line of text for each signal; without `whole`, short ones for a narrow terminal."""
    width = max((len(each.signal.name) for each in found), default=0)
    return [each.line(width, whole=whole) for each in found]
