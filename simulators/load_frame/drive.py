"""The drive of a simulated load frame: how fast the crosshead can change its speed."""

from math import exp, inf, sqrt

from pydantic import Field

from drivers.settings import Settings


class DriveSettings(Settings):
    """Acceleration and lag of the drive in displacement control.

    The crosshead begins a motion, changes its speed, brakes before a target and brakes at a hold with this
    acceleration. With a lag, the speed also approaches each new speed exponentially. Limit switches, the
    watchdog, and the emergency stop act on a brake, which stops the crosshead at once.
    """

    acceleration_mm_s2: float = Field(default=20.0, gt=0, le=1000, description="largest acceleration")
    lag_s: float = Field(default=0.0, ge=0, le=1, description="time constant of the speed controller")


class Drive:
    """Speeds of a crosshead from one control period to the next. `period_s` is the control period."""

    def __init__(self, settings: DriveSettings, period_s: float) -> None:
        self._period_s = period_s
        self._share = 1.0 - exp(-period_s / settings.lag_s) if settings.lag_s > 0.0 else 1.0
        self.step_mm_s = settings.acceleration_mm_s2 * period_s
        """Largest change of the speed in one control period."""

    def next_speed(self, speed_mm_s: float, wanted_mm_s: float) -> float:
        """Return the speed in the next period, on the way from a speed to a wanted speed."""
        change = wanted_mm_s - speed_mm_s
        if abs(change) <= self.step_mm_s and self._share == 1.0:
            return wanted_mm_s
        return speed_mm_s + _within(self._share * change, self.step_mm_s)

    def braked(self, speed_mm_s: float) -> float:
        """Return the speed in the next period of a crosshead that brakes; 0 if it stands then."""
        return speed_mm_s - _within(speed_mm_s, self.step_mm_s)

    def approach_mm_s(self, distance_mm: float, most_mm_s: float = inf) -> float:
        """Return the largest speed from which the crosshead can stop at a target in `distance_mm`.

        In n periods the crosshead brakes over a distance of n (n + 1) / 2 steps of one period.
        """
        ratio = distance_mm / (self.step_mm_s * self._period_s)
        return min(most_mm_s, self.step_mm_s * (sqrt(0.25 + 2.0 * ratio) - 0.5))


def _within(value: float, most: float) -> float:
    return min(max(value, -most), most)
