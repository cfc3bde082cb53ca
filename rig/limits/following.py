"""Check during a load increment that the load rises steadily with the motion of the crosshead."""

import math
from collections import deque
from dataclasses import dataclass, replace

from rig.errors import ImplausibleReading
from rig.protocol.step import RigReading

WINDOW_SHARE = 0.03
"""The load should rise by this fraction of an increment in one window, or by more if the noise is large.

A window is a part of the travel over which the stiffness is measured. A stuck load cell is noticed at the
first reading after the travel of one window. The specimen then carries about this fraction of the increment
more than the load cell shows.
"""
_WINDOW_MAX_SHARE = 0.08
_WINDOW_SIGMAS, _RISE_SIGMAS, _MARGIN_SIGMAS = 10.0, 3.0, 4.0
_SOFTENING_SHARE = 0.03
"""A load that rises by less than this fraction of the expected rise does not follow the motion."""
_YIELDING_SHARE = 0.1
"""Where yielding is expected, a specimen that keeps this fraction of its stiffness must not cause an error.

So the rise is checked over a longer travel, in which the load of such a specimen rises above the noise. The
constant `_WINDOW_MAX_SHARE` limits this travel.
"""
_SOFTEST_SHARE = 0.02
_ELASTIC_SHARE = 0.7
"""A specimen that is certainly elastic keeps at least this share of its stiffness.

In a motion without a stop, a load cell that drifts is not noticed at rest. It makes the specimen seem softer.
"""
_SMOOTH = 3
"""Number of readings whose mean load and mean displacement are used instead of single readings.

Noise can raise a single reading and so end a window too early. Single readings would therefore give a biased
stiffness.
"""
_TANGENT_WINDOWS = 3
"""Number of windows over which a stiffness is measured."""


@dataclass(frozen=True)
class History:
    """The relation of load to displacement in earlier increments."""

    stiffness_n_mm: float | None = None  # largest stiffness so far, or None in the first increment
    highest_n: float = -math.inf  # highest load so far. Up to this load, the specimen is elastic.
    # stiffness of the first loading at the highest load. A further increment has this stiffness when it
    # passes the highest load.
    beyond_n_mm: float | None = None


class Following:
    """Divides an increment of load into windows, and expects a rise of the load in each window.

    The length of a window is computed from the stiffness in the windows before. A yielding specimen becomes
    softer from window to window, so plastic deformation is no error. It is an error if the load suddenly
    stops rising from one window to the next.

    Parameters
    ----------
    start : RigReading
        The last reading before the motion.
    outward : float
        1 if the load should rise, -1 if the load should fall.
    increment_n : float
        Size of the increment.
    noise_n, noise_mm : float
        Standard deviations of load and displacement.
    history : History
    elastic_n : float
        Load up to which the specimen is not expected to yield.
    flow_mm : float
        Travel in mm at constant load that the protocol allows.
    keeps_stiffness : bool
        True if a specimen that becomes softer is an error, also if its load rises.
    """

    def __init__(
        self,
        start: RigReading,
        *,
        outward: float,
        increment_n: float,
        noise_n: float,
        noise_mm: float,
        history: History,
        elastic_n: float,
        flow_mm: float,
        keeps_stiffness: bool = False,
    ) -> None:
        self.stiffness_n_mm: float | None = None
        self._outward = outward
        self._increment_n = increment_n
        self._noise_n, self._noise_mm = noise_n, noise_mm
        self._history = history
        self._elastic_n = elastic_n
        self._flow_mm = flow_mm
        self._keeps_stiffness = keeps_stiffness and not flow_mm > 0.0
        self._tangent_n_mm: float | None = None
        self._tangent_before_n_mm: float | None = None
        self._ends = deque([start], maxlen=_TANGENT_WINDOWS + 1)
        self._judged = deque([start])
        self._last: deque[RigReading] = deque(maxlen=_SMOOTH)
        self._same_since = start

    @property
    def tangent_n_mm(self) -> float | None:
        """Stiffness in the last windows, or None before the end of the first window."""
        return self._tangent_n_mm

    def check(self, reading: RigReading, step: str) -> None:
        """Check one reading. Raise `ImplausibleReading` if the load does not follow the motion."""
        if reading.load_n != self._same_since.load_n:
            self._same_since = reading
        self._last.append(reading)
        shown, reading = reading, _mean(self._last)
        expected_n_mm = self._expected_n_mm(reading)
        # Noise of the displacement also counts, because it changes the load that belongs to the displacement.
        noise_n = math.hypot(self._noise_n, (expected_n_mm or 0.0) * self._noise_mm)
        longest_n = _WINDOW_MAX_SHARE * self._increment_n
        window_n = min(max(WINDOW_SHARE * self._increment_n, _WINDOW_SIGMAS * noise_n), longest_n)
        if expected_n_mm is None:
            if self._since(self._ends[-1], reading)[0] >= window_n:
                self._end_window(reading)
            return
        # A correct load cell has noise and does not repeat a number, so a repeated number is an error.
        repeated_mm = self._since(self._same_since, shown)[1]
        if repeated_mm > self._travel_mm(window_n / expected_n_mm):
            raise self._stopped_to_follow(shown, step, self._noise_n, 0.0, repeated_mm)
        rise_noise_n = noise_n * math.sqrt(2.0 / _SMOOTH)
        least_n = max(_RISE_SIGMAS * rise_noise_n, _SOFTENING_SHARE * window_n)
        judged_n = window_n
        if reading.load_n > self._elastic_n:
            yielding_n = (least_n + _RISE_SIGMAS * rise_noise_n) / _YIELDING_SHARE
            judged_n = min(max(window_n, yielding_n), longest_n)
        self._judge(reading, step, least_n, self._travel_mm(judged_n / expected_n_mm))
        rise_n, travel_mm = self._since(self._ends[-1], reading)
        if rise_n >= window_n or travel_mm > self._travel_mm(judged_n / expected_n_mm):
            self._end_window(reading)
            self._require_stiffness(shown, step)

    def _judge(self, reading: RigReading, step: str, least_n: float, judged_mm: float) -> None:
        """Raise an error if the load has risen by less than `least_n` over the last `judged_mm` of travel."""
        begins = self._judged
        begins.append(reading)
        while self._since(begins[1], reading)[1] > judged_mm:
            begins.popleft()
        rise_n, travel_mm = self._since(begins[0], reading)
        if travel_mm > judged_mm and rise_n < least_n:
            raise self._stopped_to_follow(reading, step, least_n, rise_n, travel_mm)

    def _travel_mm(self, needed_mm: float) -> float:
        return needed_mm + self._flow_mm + _MARGIN_SIGMAS * self._noise_mm

    def _expected_n_mm(self, reading: RigReading) -> float | None:
        """Return the stiffness that the next readings should show, or None if nothing is known about it."""
        known = self._history
        # The load may have stopped rising within the last window, so the window before counts too.
        tangents = [each for each in (self._tangent_n_mm, self._tangent_before_n_mm) if each is not None]
        expected_n_mm = max(tangents, default=known.stiffness_n_mm)
        if expected_n_mm is None or known.beyond_n_mm is None or self._outward < 0.0:
            return expected_n_mm
        margin_n = _WINDOW_MAX_SHARE * self._increment_n
        if self._ends[0].load_n < known.highest_n <= reading.load_n + margin_n:
            # Above the highest load so far, a yielding specimen continues with the stiffness that it had
            # there.
            return min(expected_n_mm, known.beyond_n_mm)
        return expected_n_mm

    def _since(self, begin: RigReading, reading: RigReading) -> tuple[float, float]:
        return (
            self._outward * (reading.load_n - begin.load_n),
            self._outward * (reading.displacement_mm - begin.displacement_mm),
        )

    def _end_window(self, reading: RigReading) -> None:
        self._ends.append(reading)
        rise_n, travel_mm = self._since(self._ends[0], reading)
        if travel_mm <= 0.0:
            return
        tangent_n_mm = rise_n / travel_mm
        if len(self._ends) > _TANGENT_WINDOWS:
            self.stiffness_n_mm = max(self.stiffness_n_mm or 0.0, tangent_n_mm)
        stiffest_n_mm = max(self.stiffness_n_mm or 0.0, self._history.stiffness_n_mm or 0.0)
        self._tangent_before_n_mm = self._tangent_n_mm
        self._tangent_n_mm = max(tangent_n_mm, _SOFTEST_SHARE * stiffest_n_mm)

    def _require_stiffness(self, shown: RigReading, step: str) -> None:
        """Raise an error if a specimen that is certainly elastic has become softer."""
        stiffest_n_mm, tangent_n_mm = self.stiffness_n_mm, self._tangent_n_mm
        if not self._keeps_stiffness or stiffest_n_mm is None or tangent_n_mm is None:
            return
        if tangent_n_mm < _ELASTIC_SHARE * stiffest_n_mm:
            raise ImplausibleReading(
                step,
                f"{stiffest_n_mm:.4g} N/mm or a little less, because the specimen is elastic up to "
                f"{self._elastic_n:.6g} N",
                f"{tangent_n_mm:.4g} N/mm at {shown.load_n:.5g} N: the load cell drifts, or the specimen "
                "yields or slips",
                "look at the specimen and check the load cell; if the specimen yields here, lower elastic_n",
            )

    def _stopped_to_follow(
        self, reading: RigReading, step: str, least_n: float, rise_n: float, travel_mm: float
    ) -> ImplausibleReading:
        return ImplausibleReading(
            step,
            f"a load that follows the motion, by {least_n:.3g} N or more over {travel_mm:.3g} mm",
            f"{rise_n:+.3g} N at {reading.load_n:.5g} N: the load cell is stuck, or the specimen yields or "
            "slips at constant load",
            "look at the specimen and check the load cell; if the specimen yields or slips at constant load, "
            f"set plausible.flow_mm above {travel_mm:.2g}",
        )


def _mean(readings: deque[RigReading]) -> RigReading:
    count = len(readings)
    return replace(
        readings[-1],
        load_n=sum(each.load_n for each in readings) / count,
        displacement_mm=sum(each.displacement_mm for each in readings) / count,
    )
