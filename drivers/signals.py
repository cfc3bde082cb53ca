"""Interfaces of devices that measure signals, and of output lines that give pulses."""

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from drivers.interfaces import DeviceInfo


@dataclass(frozen=True)
class Signal:
    """A quantity that a channel device measures, as the rig file declares it.

    Attributes
    ----------
    name : str
        Name of the signal in the rig file. All signals of a rig have different names.
    unit : str
    low, high : float
        Range in which a value is valid, in `unit`. A value outside of it is a fault, such as an amplifier at
        its end.
    delay_s, delay_std_s : float
        Time by which the values are later than the quantity, for example because of a filter, and the
        standard deviation of this time.
    std : float
        Standard deviation of the noise of one value, in `unit`; 0 if it is unknown.
    """

    name: str
    unit: str
    low: float
    high: float
    delay_s: float = 0.0
    delay_std_s: float = 0.0
    std: float = 0.0


@dataclass(frozen=True)
class Samples:
    """Consecutive samples of all signals of a channel device, the oldest first.

    Attributes
    ----------
    values : ndarray of float, shape (n, signals)
        In the units of the signals. A value that the device itself calls invalid is NaN.
    first : int
        Number of the first sample since the device was opened. A gap in the numbers means lost samples.
    received_s : float
        Time at which the program received the samples, in seconds on the rig's clock.
    asked_s : float
        Earliest possible time of the first sample on the rig's clock, for a device that measures when it is
        asked; -inf for a device that measures by its own clock.
    device_s : ndarray of float, shape (n,), or None
        Times of the samples on the device's own clock, in s; None if the device has no clock.
    """

    values: NDArray[np.float64]
    first: int
    received_s: float
    asked_s: float = -math.inf
    device_s: NDArray[np.float64] | None = None


class ChannelDevice(Protocol):
    """Interface of a device that measures one or more signals, such as the box at a machine's outputs.

    It measures from its opening on, and commands nothing.

    Attributes
    ----------
    signals : tuple of Signal
    rate_hz : float
        Number of samples per second; 0 if samples come at no fixed rate.

    A device may also have an attribute `silence_s`: the time in s without a sample after which a run ends.
    Without it, a run ends after ten missing samples, and never if there is no fixed rate.
    """

    info: DeviceInfo
    signals: tuple[Signal, ...]
    rate_hz: float

    def read(self, timeout_s: float) -> Samples:
        """Return all samples since the last call, at least one.

        Wait for a sample if there is none. Raise `DeviceTimeout` if none comes within `timeout_s`, and
        another `DeviceError` if the device fails. No sample is returned twice.
        """

    def close(self) -> None:
        """Release the device. A repeated call has no effect."""


class TriggerOutput(Protocol):
    """Interface of an output line that gives a pulse, for example to the data logger of another machine."""

    info: DeviceInfo

    def pulse(self) -> None:
        """Give one pulse, and return when it has begun. Raise `DeviceError` if it may not have been given."""

    def close(self) -> None:
        """Leave the line in its state of rest, and release the device. A repeated call has no effect."""
