"""Noise and drift of load and displacement at rest, measured before and between motions."""

import math
from dataclasses import dataclass, field

from rig.protocol.step import RigReading

_READINGS_MIN = 5
_PARTS = 2.0


@dataclass
class ReadingNoise:
    """Standard deviations of load and displacement, from the differences of successive readings at rest.

    A slow change, such as a relaxation of the specimen, hardly adds to these differences.
    """

    _load_n2: float = 0.0
    _displacement_mm2: float = 0.0
    _count: int = 0
    _last: RigReading | None = None

    def add(self, reading: RigReading) -> None:
        """Add a reading taken while the crosshead stands still."""
        if self._last is not None:
            self._load_n2 += (reading.load_n - self._last.load_n) ** 2
            self._displacement_mm2 += (reading.displacement_mm - self._last.displacement_mm) ** 2
            self._count += 1
        self._last = reading

    def interrupt(self) -> None:
        """Do not compare the next reading with the last one, because the crosshead moves between them."""
        self._last = None

    def load_n(self, default_n: float) -> float:
        """Return the load's standard deviation in N, or `default_n` if there are too few readings."""
        return self._deviation(self._load_n2, default_n)

    def displacement_mm(self, default_mm: float) -> float:
        """Return the displacement's standard deviation in mm, or `default_mm` if there are too few
        readings."""
        return self._deviation(self._displacement_mm2, default_mm)

    def _deviation(self, sum_of_squares: float, default: float) -> float:
        # The difference of two readings has twice the variance of one reading.
        return math.sqrt(sum_of_squares / self._count / 2.0) if self._count >= _READINGS_MIN else default


@dataclass
class Rest:
    """The readings of the load while everything stands still, for the detection of a drift."""

    _times_s: list[float] = field(default_factory=list)
    _loads_n: list[float] = field(default_factory=list)

    def add(self, reading: RigReading) -> None:
        """Add a reading taken while the crosshead stands still."""
        self._times_s.append(reading.time_s)
        self._loads_n.append(reading.load_n)

    def clear(self) -> None:
        """Delete all readings, because a motion begins or the load was set to zero."""
        self._times_s.clear()
        self._loads_n.clear()

    @property
    def count(self) -> int:
        """Number of readings."""
        return len(self._times_s)

    @property
    def duration_s(self) -> float:
        """Time in s from the first to the last reading."""
        return self._times_s[-1] - self._times_s[0] if self._times_s else 0.0

    @property
    def elapsed_s(self) -> float:
        """Time in s from the first reading at rest to the middle of the readings that `drift` uses."""
        return self.duration_s * (1.0 - 0.5 / _PARTS)

    def drift(self, noise_n: float) -> tuple[float, float] | None:
        """Return the slope of the load in N/s in the later half of the time, and its standard deviation.

        The later half is used because a relaxation slows down with time. If there are too few readings,
        return None.
        """
        if not self._times_s:
            return None
        begin_s = self._times_s[-1] - self.duration_s / _PARTS
        pairs = [
            (time_s, load_n)
            for time_s, load_n in zip(self._times_s, self._loads_n, strict=True)
            if time_s >= begin_s
        ]
        if len(pairs) < _READINGS_MIN:
            return None
        mean_s = math.fsum(time_s for time_s, _ in pairs) / len(pairs)
        spread_s2 = math.fsum((time_s - mean_s) ** 2 for time_s, _ in pairs)
        if spread_s2 == 0.0:
            return None
        slope_n_s = math.fsum((time_s - mean_s) * load_n for time_s, load_n in pairs) / spread_s2
        return slope_n_s, noise_n / math.sqrt(spread_s2)
