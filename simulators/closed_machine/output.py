"""A voltage output of the machine, with all that makes a measured voltage differ from the quantity."""

import math
from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from simulators.closed_machine.settings import OutputSettings

FULL_SCALE_V = 10.0
NOISE_PERIOD_S = 0.001
"""The noise of the voltage is independent after this time."""
_BLOCK = 1024


class Draws:
    """Random numbers that belong to places 0, 1, 2, …, so that they do not depend on who asks, and when.

    `seed` and `stream` choose the numbers; two streams are independent.
    """

    def __init__(self, seed: int, stream: int) -> None:
        self._key = (seed, stream)
        self._block = lru_cache(maxsize=8)(self._drawn)

    def normal(self, place: int) -> float:
        """Return the standard normal number of a place."""
        return float(self._block(place // _BLOCK)[0][place % _BLOCK])

    def uniform(self, place: int) -> float:
        """Return the number of a place that is uniform from -0.5 to 0.5."""
        return float(self._block(place // _BLOCK)[1][place % _BLOCK]) - 0.5

    def _drawn(self, block: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        rng = np.random.default_rng([*self._key, block])
        return rng.standard_normal(_BLOCK), rng.random(_BLOCK)


class VoltageOutput:
    """The voltage that shows a quantity, late and disturbed. Equal times give equal voltages.

    Parameters
    ----------
    settings : OutputSettings
    quantity : callable
        ``quantity(time_s)`` returns the true value at a time, in seconds since the machine was switched on.
    draws : Draws
    """

    def __init__(self, settings: OutputSettings, quantity: Callable[[float], float], draws: Draws) -> None:
        self._settings, self._quantity, self._draws = settings, quantity, draws
        self._phase = math.tau * draws.uniform(0)

    def delay_s(self, time_s: float) -> float:
        """Return by how much the voltage at a time is late."""
        settings = self._settings
        period = math.floor(time_s / settings.jitter_period_s)
        return settings.delay_s + settings.jitter_s * self._draws.uniform(period)

    def volts(self, time_s: float) -> float:
        """Return the voltage at a time. The amplifier cannot go beyond its ends."""
        settings = self._settings
        shown = self._quantity(max(0.0, time_s - self.delay_s(time_s)))
        hum = math.sin(math.tau * settings.hum_hz * time_s + self._phase)
        volts = (
            settings.offset_v
            + FULL_SCALE_V * shown / settings.full_scale
            + settings.drift_v_h * time_s / 3600.0
            + settings.hum_v * hum
            + settings.noise_v * self._draws.normal(math.floor(time_s / NOISE_PERIOD_S))
        )
        return min(max(volts, -settings.end_v), settings.end_v)
