"""Live gauges whose strain is a known function of the crosshead, for tests of what steers by it."""

from collections.abc import Callable

from drivers.clock import Clock
from drivers.interfaces import Frame
from rig.live.values import GaugeValue, LiveReading


class FakeLive:
    """A `LiveMeasurement`. `strain(time_s)` is the truth; `invalid(time_s)` says why a value is not valid."""

    def __init__(self, clock: Clock, strain: Callable[[float], float], gauges: tuple[str, ...] = ("axial",)):
        self.failed, self.left_out = "", 0
        self.invalid: Callable[[float], str] = lambda time_s: ""
        self.prepared: list[set[str]] = []
        self.closed = False
        self._clock, self._strain, self._gauges = clock, strain, gauges
        self._found: list[LiveReading] = []

    def prepare(self, grids, references) -> None:
        self.prepared.append(set(references))

    def offer(self, camera: str, frame: Frame) -> None:
        time_s = frame.middle[0]
        why = self.invalid(time_s)
        if why == "dead":
            return
        value = GaugeValue(self._strain(time_s), 1e-5, not why, why, "corrected", camera)
        values = dict.fromkeys(self._gauges, value)
        self._found.append(LiveReading(time_s, 0.0, self._clock.now_s(), {camera: frame.sequence}, values))

    def take(self) -> list[LiveReading]:
        found, self._found = self._found, []
        return found

    def close(self) -> None:
        self.closed = True
