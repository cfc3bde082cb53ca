"""The law that keeps a strain rate by the speed of the crosshead.

The crosshead moves the gauge: its strain rate is the gain g times the speed. The gain changes: a soft machine
takes up most of the motion while the specimen is elastic, and nearly none when it yields. So the gain is
measured all the time, as the slope of strain over displacement in the last seconds, and the speed is

    v = (rate + c * (wanted strain - strain)) / g.

The load is known more often than the strain, and with less noise. A specimen that begins to yield shows it
first: the gain then follows from the fall of the stiffness, before the strain of the next image is known.

With the right gain this is a first-order loop with the bandwidth c for every specimen and machine. With a
dead time T from the exposure to the new speed, it is stable as long as the gain is larger than the measured
one by less than pi / (2 c T), without overshoot up to 1 / (e c T). docs/strain-control.md has the proof.
"""

import math
from collections import deque
from typing import NamedTuple

from rig.protocol.pull_stages import StrainRate

BANDWIDTH_S = 3.0
"""The bandwidth c in 1/s where the dead time permits it."""
_DEAD_SHARE = 0.15
"""c times the dead time is at most this. The gain may then be 10 times larger than measured."""
_MACHINE_S = 0.1
"""Time in s in which a machine takes over a new speed, part of the dead time."""
_WINDOW_S, _WINDOW_STRAIN = 0.6, 2e-4
"""The gain is measured over at least this time in s, and at least this strain unless it takes too long."""
_WINDOW_MOST_S = 6.0
_SAMPLES_LEAST = 5
_LEAD_S = 1.0
"""The wanted strain leads or trails the strain by at most what the rate gives in this time in s. This bounds
the error that builds up while the speed is at a bound (anti-windup)."""
_REACHED = 0.9
_SOFT = 0.02
"""A tangent stiffness below this share of the highest one means yielding."""
_UNIFORM = (0.4, 3.0)
"""While a uniform specimen yields, its gauge shows this many times the displacement over the parallel length.
Elsewhere a band of yielding is passing: it is in the gauge, or it is not."""
_RISE, _AHEAD = 0.05, 3.0
"""If the gain of the newer half of the points is higher by more than the first share, three times this rise
is added: yielding begins, and until the next speed is in force the gain rises further."""
_FALL = 0.3
"""The measured gain changes by at most this share from one value to the next, against outliers."""
_BEFORE_S, _NEWEST_S = 0.6, 0.09
"""The stiffness of the newest readings is compared with that before, over these times in s."""
_NEWEST_LEAST, _BEFORE_LEAST = 4, 8
_FALL_SIGMAS = 4.0
"""A stiffness that is lower by this many standard deviations has fallen."""


class Way(NamedTuple):
    """A reading of load and displacement."""

    time_s: float
    displacement_mm: float
    load_n: float


class Point(NamedTuple):
    """A valid strain, and displacement and load at its time."""

    time_s: float
    strain: float
    displacement_mm: float
    load_n: float


class StrainRateControl:
    """Computes the speed of the crosshead from the strain of a gauge.

    Strains, displacements and loads are given in the direction of the test: positive, also in compression.

    Attributes
    ----------
    speed_mm_s : float
        The wanted speed.
    is_discontinuous : bool
        True once the specimen yields discontinuously. From then on the speed is constant (method A2).
    """

    def __init__(self, kept: StrainRate, interval_s: float, latency_s: float) -> None:
        self._kept = kept
        dead_s = interval_s + latency_s + _MACHINE_S
        self._c_s = min(BANDWIDTH_S, _DEAD_SHARE / dead_s)
        self._gain_mm = 1.0 / kept.parallel_length_mm
        self._points: deque[Point] = deque()
        self._wanted = math.nan
        self._is_reached = False
        self._stiffest_n_mm = 0.0
        self._highest_n = -math.inf
        self._loads_n: deque[float] = deque(maxlen=3)
        self._ways: deque[Way] = deque()
        self._measured: tuple[float, float] | None = None
        self.speed_mm_s = kept.crosshead_mm_s
        self.is_discontinuous = False

    @property
    def gain_mm(self) -> float:
        """The measured gain: strain per mm of the crosshead."""
        return self._gain_mm

    def begin_again(self) -> None:
        """Begin anew after the machine was held; what was measured about the gain stays."""
        self._points.clear()
        self._wanted = math.nan
        self._is_reached = False
        self._highest_n = -math.inf
        self._loads_n.clear()
        self._ways.clear()
        self._measured = None
        self.speed_mm_s = min(self.speed_mm_s, self._kept.crosshead_mm_s)

    def see_load(self, way: Way) -> None:
        """Take a reading of the load. It falls, or it rises more slowly, if the specimen begins to yield."""
        self._loads_n.append(way.load_n)
        if not self._ways or way.time_s > self._ways[-1].time_s:
            self._ways.append(way)
            self._slow_down()
        if len(self._loads_n) < 3:
            return
        # the middle of three: one wrong sample is no fall
        middle_n = sorted(self._loads_n)[1]
        self._highest_n = max(self._highest_n, middle_n)
        if self._highest_n > 0.0 and middle_n < (1.0 - self._kept.yield_drop) * self._highest_n:
            self._yield_in_bands()

    def see(self, point: Point) -> None:
        """Take a valid strain, and set the speed."""
        if self.is_discontinuous or (self._points and point.time_s <= self._points[-1].time_s):
            return
        kept, strain = self._kept, point.strain
        elapsed_s = point.time_s - self._points[-1].time_s if self._points else 0.0
        self._points.append(point)
        if self._finds_bands():
            self._yield_in_bands()
            return
        lead = _LEAD_S * kept.rate_s
        wanted = strain if math.isnan(self._wanted) else self._wanted + kept.rate_s * elapsed_s
        self._wanted = min(max(wanted, strain - lead), strain + lead)
        rate_s = kept.rate_s + self._c_s * (self._wanted - strain)
        bounds = kept.bounds
        speed_mm_s = min(max(rate_s / self._gain_mm, bounds.least_mm_s), bounds.greatest_mm_s)
        # It may always become slower at once: only a rise can overload the specimen.
        allowed_mm_s = self.speed_mm_s + bounds.acceleration_mm_s2 * elapsed_s
        self.speed_mm_s = min(speed_mm_s, allowed_mm_s)
        self._is_reached = self._is_reached or self._has_reached()
        if not self._is_reached:
            # What is missing at the beginning is not caught up by a higher rate.
            self._wanted = strain

    def _has_reached(self) -> bool:
        """Return whether the strain has risen at nearly the wanted rate since the first kept point.

        The speed times the measured gain would say so too early, because the gain is noisy at first.
        """
        first, last = self._points[0], self._points[-1]
        least = _REACHED * self._kept.rate_s * (last.time_s - first.time_s)
        return self._is_enough(0) and last.strain - first.strain >= least

    def _slow_down(self) -> None:
        """Lower the speed at once if the stiffness has fallen since the gain was measured.

        Specimen and machine in series have the gain g = (1 - S/k) / L with the stiffness S of both, that of
        the machine k, and the parallel length L. So a known pair of g and S gives g for another S.
        """
        ways = self._ways
        while ways[-1].time_s - ways[0].time_s > _BEFORE_S + _NEWEST_S:
            ways.popleft()
        newest = [way for way in ways if ways[-1].time_s - way.time_s <= _NEWEST_S]
        newest = newest if len(newest) >= _NEWEST_LEAST else list(ways)[-_NEWEST_LEAST:]
        before = list(ways)[: -len(newest)]
        if self.is_discontinuous or self._measured is None or len(before) < _BEFORE_LEAST:
            return
        _, _, noise_n = _line(before)
        slope_n_mm, spread_mm, _ = _line(newest)
        gain_mm, stiffness_n_mm = self._measured
        if math.isnan(slope_n_mm) or not stiffness_n_mm > 0.0:
            return
        fall_n_mm = stiffness_n_mm - max(slope_n_mm, 0.0)
        if not fall_n_mm > _FALL_SIGMAS * noise_n / spread_mm:
            return
        most_mm = 1.0 / self._kept.parallel_length_mm
        now_mm = gain_mm + fall_n_mm / stiffness_n_mm * (most_mm - gain_mm)
        if now_mm > self._gain_mm:
            # The correction of the strain stays in proportion.
            self.speed_mm_s = max(self.speed_mm_s * self._gain_mm / now_mm, self._kept.bounds.least_mm_s)
            self._gain_mm = now_mm

    def _yield_in_bands(self) -> None:
        self.is_discontinuous = True
        self.speed_mm_s = self._kept.crosshead_mm_s

    def _finds_bands(self) -> bool:
        """Measure gain and stiffness over the newest points. Return True if the specimen yields in bands."""
        points = self._points
        while len(points) > _SAMPLES_LEAST and self._is_enough(1):
            points.popleft()
        if len(points) < _SAMPLES_LEAST or points[-1].time_s - points[0].time_s < 0.5 * _WINDOW_S:
            return False
        gain_mm, stiffness_n_mm = self._slopes(0)
        newest_mm, _ = self._slopes(len(points) // 2)
        if math.isnan(gain_mm) or math.isnan(newest_mm):
            return False
        measured_mm = gain_mm
        rise_mm = newest_mm - gain_mm
        if rise_mm > _RISE * gain_mm:
            # A specimen that yields everywhere has this gain, so none is expected to rise beyond it.
            gain_mm = max(gain_mm, min(gain_mm + _AHEAD * rise_mm, 1.0 / self._kept.parallel_length_mm))
        low_mm, high_mm = (1.0 - _FALL) * self._gain_mm, (1.0 + _FALL) * self._gain_mm
        # The bounds of the speed are bounds of the gain as well.
        kept = self._kept
        least_mm = kept.rate_s / kept.bounds.greatest_mm_s
        most_mm = kept.rate_s / kept.bounds.least_mm_s
        self._gain_mm = min(max(gain_mm, low_mm, least_mm), high_mm, most_mm)
        if not self._is_enough(0):
            return False
        self._measured = measured_mm, stiffness_n_mm
        self._stiffest_n_mm = max(self._stiffest_n_mm, stiffness_n_mm)
        uniform = gain_mm * kept.parallel_length_mm
        is_soft = stiffness_n_mm < _SOFT * self._stiffest_n_mm
        return is_soft and not _UNIFORM[0] < uniform < _UNIFORM[1]

    def _slopes(self, first: int) -> tuple[float, float]:
        """Return the slopes of strain and of load over displacement; NaN where nothing has moved."""
        points = list(self._points)[first:]
        count = len(points)
        mean_mm = sum(point.displacement_mm for point in points) / count
        offs_mm = [point.displacement_mm - mean_mm for point in points]
        spread_mm2 = sum(off_mm**2 for off_mm in offs_mm)
        if not spread_mm2 > 0.0:
            return math.nan, math.nan
        pairs = list(zip(points, offs_mm, strict=True))
        return (
            sum(point.strain * off_mm for point, off_mm in pairs) / spread_mm2,
            sum(point.load_n * off_mm for point, off_mm in pairs) / spread_mm2,
        )

    def _is_enough(self, first: int) -> bool:
        """Return whether the points from the given one on are enough to measure the gain."""
        points = self._points
        elapsed_s = points[-1].time_s - points[first].time_s
        strained = points[-1].strain - points[first].strain
        return elapsed_s >= _WINDOW_MOST_S or (elapsed_s >= _WINDOW_S and strained >= _WINDOW_STRAIN)


def _line(ways: list[Way]) -> tuple[float, float, float]:
    """Return the slope of load over displacement, the root of the sum of squares of the displacements around
    their mean, and the standard deviation of the loads from the line; NaN where nothing has moved."""
    count = len(ways)
    mean_mm, mean_n = (
        sum(way.displacement_mm for way in ways) / count,
        sum(way.load_n for way in ways) / count,
    )
    offs = [(way.displacement_mm - mean_mm, way.load_n - mean_n) for way in ways]
    spread_mm2 = sum(off_mm**2 for off_mm, _ in offs)
    if not spread_mm2 > 0.0:
        return math.nan, math.nan, math.nan
    slope_n_mm = sum(off_mm * off_n for off_mm, off_n in offs) / spread_mm2
    rest_n2 = sum((off_n - slope_n_mm * off_mm) ** 2 for off_mm, off_n in offs)
    return slope_n_mm, math.sqrt(spread_mm2), math.sqrt(rest_n2 / (count - 2))
