"""Times of a channel device's samples on the rig's clock, with their standard deviations.

A device that measures when it is asked has measured somewhere between question and answer. A device that
measures by its own clock tells its own times, and its samples come later by a transport time, which is never
negative and sometimes short. So the difference between both clocks is the least difference that was ever
seen, and the drift of the device's clock is the slope of the least differences of many seconds.
"""

import math
from collections import deque

import numpy as np

from drivers.errors import DeviceFault
from drivers.signals import Samples
from rig.samples import Floats

_BIN_S = 1.0
_BINS = 60
"""The least difference of each second is kept for a minute: drift is linear for that time."""
_BINS_FOR_DRIFT = 10
_LEAST_TRANSPORT_S = 0.002
"""Standard deviation of the shortest transport time, which no difference of clocks shows: the next frame of
USB, a switch on the network, the waking of a thread."""


class TimeLine:
    """The times of the samples of one device. `device` is its name, for messages."""

    def __init__(self, device: str) -> None:
        self._device = device
        self._least: deque[tuple[float, float]] = deque(maxlen=_BINS)
        self._bin = -math.inf
        self._last_s = -math.inf
        self._line: tuple[float, float, float, float] | None = None

    def of(self, samples: Samples) -> tuple[Floats, Floats]:
        """Return the times of samples on the rig's clock and their standard deviations, shapes (n,).

        Raise `DeviceFault` if the device's clock runs backwards.
        """
        if samples.device_s is None:
            middle_s = (samples.asked_s + samples.received_s) / 2
            # a uniform distribution
            std_s = (samples.received_s - samples.asked_s) / math.sqrt(12.0)
            return np.array([middle_s]), np.array([std_s])
        device_s = samples.device_s
        if not device_s[0] > self._last_s:
            raise DeviceFault(
                self._device,
                "read samples",
                f"times after {self._last_s:.6g} s on the device's clock",
                f"{device_s[0]:.6g} s",
                "find out whether the device was switched off and on, then begin a new run",
            )
        self._last_s = float(device_s[-1])
        self._see(self._last_s, samples.received_s - self._last_s)
        return self._on_rig(device_s)

    def _see(self, device_s: float, difference_s: float) -> None:
        number = device_s // _BIN_S
        if number > self._bin:
            self._bin = number
            self._least.append((device_s, difference_s))
        elif difference_s < self._least[-1][1]:
            self._least[-1] = device_s, difference_s
        else:
            return
        self._line = None

    def _on_rig(self, device_s: Floats) -> tuple[Floats, Floats]:
        # Most samples change nothing of the line, and a device may give a thousand of them in a second.
        self._line = self._line or self._fitted()
        last_s, offset_s, drift, std_s = self._line
        return device_s + offset_s + drift * (device_s - last_s), np.full(len(device_s), std_s)

    def _fitted(self) -> tuple[float, float, float, float]:
        """Return a time on the device's clock, the difference of both clocks there, the drift, and the
        standard deviation."""
        at_s, least_s = np.array(self._least).T
        drift = 0.0
        if len(at_s) >= _BINS_FOR_DRIFT:
            drift = float(np.polyfit(at_s - at_s[-1], least_s, 1)[0])
        left_s = least_s - drift * (at_s - at_s[-1])
        # Transport only adds to a difference, so the least one is nearest to the truth. By how much the least
        # of a second exceeds the least of all tells how near.
        offset_s = float(left_s.min())
        spread_s = float(np.sqrt(np.mean((left_s - offset_s) ** 2))) if len(left_s) > 1 else 0.0
        std_s = math.hypot(_LEAST_TRANSPORT_S, spread_s / math.sqrt(len(left_s)))
        return float(at_s[-1]), offset_s, drift, std_s
