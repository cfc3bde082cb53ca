"""Check that the crosshead is not faster than a command or a plausible specimen requires."""

import math
from collections import deque

from rig.errors import LimitViolation
from rig.limits.run_limits import RunLimits
from rig.protocol.step import ProtocolStep, RigReading

_SPAN_S = 0.25
"""Time in s over which a speed is measured, because the time between two readings may be wrong by
`_JITTER_S`."""
_JITTER_S = 0.1
_TAKES_OVER_S = 0.5
"""Time in s in which a machine takes over a lower speed."""
_MARGIN = 1.5
_NOISE_MM = 0.005


class SpeedCheck:
    """Checks the speed of the crosshead at every reading."""

    def __init__(self, limits: RunLimits) -> None:
        string = limits.string
        self._of_load_mm_s = None if string is None else string.speed_max_mm_s
        self._elastic_n = 0.0 if string is None else string.first_n
        self._of_rig_mm_s = limits.table.greatest("speed")
        self._greatest_mm_s: float | None = None
        self._source = ""
        self._first_increment = True
        self._readings: deque[RigReading] = deque()
        self._commanded: deque[tuple[float, float]] = deque()

    def begin(self, step: ProtocolStep) -> None:
        """Begin a step, and determine the largest allowed speed of this step."""
        self._readings.clear()
        self._commanded.clear()
        self._greatest_mm_s, self._source = self._of_rig_mm_s, "the rig's load_frame.speed_max_mm_s"
        if step.kind == "displacement":
            self._greatest_mm_s, self._source = step.rate, "the commanded speed"
        elif step.pulls and self._first_increment and self._of_load_mm_s is not None:
            self._greatest_mm_s, self._source = self._of_load_mm_s, "plausible.speed_max_mm_s"

    def change(self, speed_mm_s: float) -> None:
        """Note a new speed of a motion that goes on. For a short time the one before is allowed too."""
        now_s = self._readings[-1].time_s if self._readings else -math.inf
        self._commanded.append((now_s, speed_mm_s))
        while len(self._commanded) > 1 and self._commanded[1][0] < now_s - _SPAN_S - _TAKES_OVER_S:
            self._commanded.popleft()
        self._greatest_mm_s = max(speed_mm_s for _, speed_mm_s in self._commanded)
        self._source = "the commanded speed"

    def check(self, reading: RigReading, step: str) -> None:
        """Check one reading. Raise `LimitViolation` if the crosshead is too fast."""
        if self._first_increment and abs(reading.load_n) > self._elastic_n:
            # After the first increment the specimen may yield, and then it stretches faster.
            self._first_increment = False
            if self._source == "plausible.speed_max_mm_s":
                self._greatest_mm_s, self._source = self._of_rig_mm_s, "the rig's load_frame.speed_max_mm_s"
        self._readings.append(reading)
        while len(self._readings) > 2 and reading.time_s - self._readings[1].time_s >= _SPAN_S:
            self._readings.popleft()
        first = self._readings[0]
        elapsed_s = reading.time_s - first.time_s
        if self._greatest_mm_s is None or elapsed_s < _SPAN_S:
            return
        travel_mm = abs(reading.displacement_mm - first.displacement_mm)
        greatest_mm_s = _MARGIN * self._greatest_mm_s
        if travel_mm > greatest_mm_s * (elapsed_s + _JITTER_S) + _NOISE_MM:
            raise LimitViolation(
                step,
                f"a speed within {greatest_mm_s:.3g} mm/s ({_MARGIN:g} times {self._source})",
                f"{travel_mm / elapsed_s:.3g} mm/s",
                "look at the specimen and check the load cell before anything moves again; if both are good, "
                "raise plausible.speed_max_mm_s",
            )
