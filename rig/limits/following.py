"""Check during a load increment that the load rises steadily with the motion of the crosshead."""

from collections import deque
from dataclasses import replace

from rig.errors import ImplausibleReading
from rig.protocol.step import Reading

WINDOW_SHARE = 0.03
"""Fraction of a load increment by which the load should rise in one window.

A stuck load cell is noticed at the first reading after the end of a window. At that time, the specimen
carries more than the load cell shows, by about this fraction of the increment."""
_WINDOW_MAX_SHARE = 0.08
_SOFTENING_SHARE = 0.03
_WINDOW_SIGMAS, _RISE_SIGMAS = 12.0, 3.0
_SOFTEST_SHARE = 0.02
_SMOOTH, _SMOOTH_BELOW_SIGMAS = 3, 250.0
"""Number of readings of which the mean is used, in an increment of less than so many deviations."""


class Following:
    """Divides an increment of load into windows, and expects a rise of the load in each window.

    The length of a window is computed from the stiffness in the window before. A yielding specimen becomes
    softer from window to window, so plastic deformation is no error. If the load suddenly stops rising from
    one window to the next, this is an error.

    Parameters
    ----------
    start : Reading
        The last reading before the motion.
    outward : float
        1 if the load should rise, -1 if the load should fall.
    increment_n : float
        Size of the increment.
    noise_n, noise_mm : float
        Standard deviations of load and displacement.
    stiffness_n_mm : float or None
        Stiffness measured in earlier load increments; None in the first increment.
    flow_mm : float
        Travel in mm at constant load that the protocol allows.
    """

    def __init__(
        self,
        start: Reading,
        *,
        outward: float,
        increment_n: float,
        noise_n: float,
        noise_mm: float,
        stiffness_n_mm: float | None,
        flow_mm: float,
    ) -> None:
        self.stiffness_n_mm: float | None = None
        self._begin = start
        self._outward = outward
        window_n = max(WINDOW_SHARE * increment_n, _WINDOW_SIGMAS * noise_n)
        self._window_n = min(window_n, _WINDOW_MAX_SHARE * increment_n)
        self._rise_min_n = max(_RISE_SIGMAS * noise_n, _SOFTENING_SHARE * self._window_n)
        self._margin_mm = 4.0 * noise_mm + flow_mm
        self._tangent_n_mm = stiffness_n_mm
        smooth = _SMOOTH if increment_n < _SMOOTH_BELOW_SIGMAS * noise_n else 1
        self._readings: deque[Reading] = deque(maxlen=smooth)

    def check(self, reading: Reading, step: str) -> None:
        """Check one reading; raise `ImplausibleReading` if the load does not follow the motion."""
        reading = self._mean(reading)
        rise_n = self._outward * (reading.load_n - self._begin.load_n)
        travel_mm = self._outward * (reading.displacement_mm - self._begin.displacement_mm)
        if rise_n >= self._window_n:
            self._next_window(reading, rise_n, travel_mm)
        elif self._tangent_n_mm is not None:
            window_mm = self._window_n / self._tangent_n_mm
            if travel_mm > window_mm + self._margin_mm:
                if rise_n < self._rise_min_n:
                    raise self._stopped_to_follow(reading, step, rise_n, travel_mm)
                self._next_window(reading, rise_n, travel_mm)

    def _mean(self, reading: Reading) -> Reading:
        # A window ends at a reading that noise has raised, so single readings would be biased.
        self._readings.append(reading)
        count = len(self._readings)
        return replace(
            reading,
            load_n=sum(each.load_n for each in self._readings) / count,
            displacement_mm=sum(each.displacement_mm for each in self._readings) / count,
        )

    def _next_window(self, reading: Reading, rise_n: float, travel_mm: float) -> None:
        self._begin = reading
        if travel_mm <= 0.0:
            return
        tangent_n_mm = rise_n / travel_mm
        self.stiffness_n_mm = max(self.stiffness_n_mm or 0.0, tangent_n_mm)
        self._tangent_n_mm = max(tangent_n_mm, _SOFTEST_SHARE * self.stiffness_n_mm)

    def _stopped_to_follow(
        self, reading: Reading, step: str, rise_n: float, travel_mm: float
    ) -> ImplausibleReading:
        return ImplausibleReading(
            step,
            f"a load that follows the motion, by {self._rise_min_n:.3g} N or more over {travel_mm:.3g} mm",
            f"{rise_n:+.3g} N at {reading.load_n:.5g} N: the load cell is stuck, or the specimen yields or "
            "slips at constant load",
            "look at the specimen and check the load cell; if the specimen yields or slips at constant load, "
            f"set plausible.flow_mm above {travel_mm:.2g}",
        )
