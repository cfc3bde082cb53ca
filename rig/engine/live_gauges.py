"""The live gauges of a run: which frames they see, and what the engine and people know of them."""

import math
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from drivers.clock import Clock
from drivers.interfaces import Frame
from rig.engine.calls import Calls, Deadline
from rig.errors import GaugeNotValid
from rig.live.curve import Curves
from rig.live.signals import RECORDED, LiveSamples, signal_readings
from rig.live.values import LiveMeasurement, LiveNow, LiveReading
from rig.protocol.live_table import LiveTable
from rig.protocol.step import RigReading
from rig.samples import GAUGE_PREFIX, SignalReading, TimedSamples

_PREPARING = Deadline(300.0, "declare fewer gauges, or a smaller region for the correction")
_RECENT = 50
_DEFAULT_S = 0.1
_PERIODS, _MARGIN_SHARE, _MARGIN_S = 2.0, 0.2, 0.02
"""A gauge without a valid value for two frame intervals and a little more is not valid."""
_RATE_OVER_S = 3.0


class LiveGauges:
    """Gives frames to the measurement of the live gauges, and keeps what it has found.

    `table` declares the gauges; it is None without them. `record` is called with the
    samples of the gauges, for the run file. `offer` may be called from any thread, the other methods by the
    engine's thread.

    Attributes
    ----------
    measurement : LiveMeasurement or None
        What measures the gauges; None in a run without them.
    newest : LiveReading or None
    is_new : bool
        True if the newest reading came with the last call of `read`.
    """

    def __init__(
        self,
        table: LiveTable | None,
        clock: Clock,
        area_mm2: float,
        record: Callable[[str, TimedSamples], None],
    ) -> None:
        self._table = table
        self._samples = None if table is None else LiveSamples(table)
        self._record = record
        self.measurement: LiveMeasurement | None = None
        self.newest: LiveReading | None = None
        self.is_new = False
        self._clock = clock
        self._images: dict[str, dict[str, Frame]] = {"grid": {}, "reference": {}}
        self._prepared = False
        self._middles_s: dict[str, deque[float]] = {}
        self._latencies_s: deque[float] = deque(maxlen=_RECENT)
        self._known_s: deque[float] = deque(maxlen=1000)
        self._valid_s: dict[str, float] = {}
        self._last: dict[str, SignalReading] = {}
        self._curves = Curves(area_mm2)

    @property
    def is_measuring(self) -> bool:
        """True if the run has live gauges that are prepared."""
        return self._prepared

    def keep(self, kind: str, frames: Mapping[str, Frame]) -> None:
        """Keep the images of the grid and of the reference, with which the measurement is prepared."""
        if self.measurement is not None and kind in self._images:
            self._images[kind] = dict(frames)

    def prepare(self, calls: Calls) -> None:
        """Prepare the measurement, once in a run; this takes seconds, while the devices are read."""
        if self.measurement is None or self._prepared:
            return
        grids, references = (
            {name: frame.image for name, frame in self._images[kind].items()}
            for kind in ("grid", "reference")
        )
        prepare = partial(self.measurement.prepare, grids, references)
        calls.finish(calls.begin("live gauges", "prepare", prepare, _PREPARING), watched=True)
        self._prepared = True

    def offer(self, camera: str, frame: Frame) -> None:
        """Give a frame that has arrived to the measurement. Any thread may call this."""
        if self.measurement is None or not self._prepared:
            return
        self._middles_s.setdefault(camera, deque(maxlen=_RECENT)).append(frame.middle[0])
        self.measurement.offer(camera, frame)

    @property
    def limited(self) -> set[str]:
        """The gauges whose strain is limited, so that nothing moves without a valid value of them."""
        table = self._table
        if table is None or (table.strain_max is None and table.strain_min is None):
            return set()
        return set(table.names)

    @property
    def interval_s(self) -> float:
        """Median time between two frames of the slowest camera, in s."""
        found = [np.median(np.diff(list(each))) for each in self._middles_s.values() if len(each) > 1]
        return float(max(found, default=_DEFAULT_S))

    @property
    def latency_s(self) -> float:
        """Median time from the middle of an exposure to its value, in s."""
        return float(np.median(self._latencies_s)) if self._latencies_s else _DEFAULT_S

    def read(self) -> dict[str, SignalReading]:
        """Take the new readings, and return the valid strains since the last call as signals."""
        if self.measurement is None or not self._prepared:
            return {}
        found = self.measurement.take()
        self.is_new = bool(found)
        for reading in found:
            self._see(reading)
        assert self._table is not None
        assert self._samples is not None
        if (samples := self._samples.of(found)) is not None:
            self._record(RECORDED, samples)
        signals = signal_readings(self._table, found)
        old, self._last = self._last, dict(self._last)
        for name, new in signals.items():
            self._last[name] = replace(new, values=new.values[-1:], time_s=new.time_s[-1:], is_new=False)
        return old | signals

    def strains(self, gauge: str, reading: RigReading) -> list[tuple[float, float]]:
        """Return the new valid strains of a gauge in a reading, with their times."""
        found = reading.signals.get(f"{GAUGE_PREFIX}{gauge}")
        if found is None or not found.is_new:
            return []
        return list(zip(found.time_s.tolist(), found.values.tolist(), strict=True))

    def draw(self, reading: RigReading) -> None:
        """Add the new strains of a reading of all devices to the curves that people see."""
        for name, found in reading.signals.items():
            if name.startswith(GAUGE_PREFIX) and found.is_new:
                self._curves.add(name.removeprefix(GAUGE_PREFIX), found.newest, reading.load_n)

    def not_valid(self, gauge: str) -> str:
        """Return why a gauge must not be used now; empty if it may be.

        A gauge may be used for two frame intervals after its last valid value.
        """
        if self.measurement is not None and (failed := self.measurement.failed):
            return failed
        interval_s, valid_s = self.interval_s, self._valid_s.get(gauge, -math.inf)
        limit_s = _PERIODS * interval_s + min(_MARGIN_SHARE * interval_s, _MARGIN_S)
        if self._clock.now_s() - valid_s <= limit_s:
            return ""
        newest = None if self.newest is None else self.newest.gauges.get(gauge)
        if newest is not None and not newest.valid:
            return newest.reason
        return f"no new value for {limit_s:.3g} s, two frame intervals"

    def require_valid(self, gauges: set[str], where: str, waited_s: float) -> None:
        """Raise `GaugeNotValid` if the gauges that a motion needs are not valid after a wait before it."""
        for gauge in sorted(gauges):
            if reason := self.not_valid(gauge):
                raise GaugeNotValid(
                    f"{where}, before its motion",
                    f"a valid strain of the gauge {gauge} within {waited_s:g} s",
                    reason,
                    "check the place of the gauge, light and focus; rig focus shows them",
                )

    def now(self, recorded: int, frames_per_s: float, lost: int) -> LiveNow | None:
        """Return what people see, None without live gauges. The arguments are for `LiveNow`."""
        if self.measurement is None or not self._prepared:
            return None
        since_s = self._clock.now_s() - _RATE_OVER_S
        values_per_s = sum(known_s >= since_s for known_s in self._known_s) / _RATE_OVER_S
        return LiveNow(
            self.newest,
            frames_per_s,
            values_per_s,
            recorded,
            lost,
            self.measurement.left_out,
            self._curves.points,
            self._curves.unit,
        )

    def close(self) -> None:
        """End the measurement."""
        if self.measurement is not None:
            self.measurement.close()

    def _see(self, reading: LiveReading) -> None:
        self.newest = reading
        self._known_s.append(reading.known_s)
        self._latencies_s.append(reading.known_s - reading.time_s)
        for gauge, value in reading.gauges.items():
            if value.valid:
                self._valid_s[gauge] = reading.known_s
