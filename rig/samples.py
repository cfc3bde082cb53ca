"""Samples of measured channels on the rig's clock."""

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]
LOAD, DISPLACEMENT = "load_frame.load", "load_frame.displacement"
"""Names of the signals of a load frame, one sample in each reading."""
GAUGE_PREFIX = "gauge."
"""The signal of a live gauge is called by this prefix and the name of the gauge."""


@dataclass(frozen=True)
class TimedSamples:
    """Samples of a channel device with their times on the rig's clock.

    Attributes
    ----------
    values : ndarray, shape (n, signals)
    time_s, time_std_s, device_s : ndarray, shape (n,)
        Times on the rig's clock without the delays of the signals, their standard deviations, and times on
        the device's own clock (NaN without one).
    first : int
        Number of the first sample.
    """

    values: Floats
    time_s: Floats
    time_std_s: Floats
    device_s: Floats
    first: int


@dataclass(frozen=True)
class SignalReading:
    """The samples of one signal since the last reading; without new ones, the newest sample again.

    Attributes
    ----------
    values : ndarray, shape (n,)
        In the unit of the signal, the oldest first.
    time_s : ndarray, shape (n,)
        Times on the rig's clock at which the signal had these values, its delay subtracted.
    is_new : bool
        False if there was no new sample.
    unit : str
    """

    values: Floats
    time_s: Floats
    is_new: bool = True
    unit: str = ""

    @property
    def newest(self) -> float:
        """The newest value."""
        return float(self.values[-1])
