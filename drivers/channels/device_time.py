"""The clock of a device, as seconds that never go back."""

import math
from typing import Literal, TypeAlias

TimeUnit: TypeAlias = Literal["s", "ms", "us", "ns"]
SECONDS: dict[TimeUnit, float] = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}


class DeviceTime:
    """Turns the times in a device's messages into seconds that increase from message to message.

    Parameters
    ----------
    unit_s : float
        The unit of the device's times, in seconds.
    wraps_at : float, optional
        The device's time begins again at 0 when it reaches this number, such as 2**32 for Arduino's `millis`.

    Attributes
    ----------
    restart : str
        After a device has begun its time anew, one sentence about it, otherwise an empty text.
    """

    def __init__(self, unit_s: float, wraps_at: float | None = None) -> None:
        self._unit_s = unit_s
        self._wraps_at = wraps_at
        self._last = -math.inf
        self._offset_s = 0.0
        self._last_s = -math.inf
        self._arrived_s = -math.inf
        self.restart = ""

    def is_repeated(self, time: float) -> bool:
        """Return whether a time is that of the message before, which then came twice."""
        return time == self._last

    def seconds(self, time: float, arrived_s: float) -> float:
        """Return the seconds of a message's time. The message arrived at `arrived_s` on the rig's clock.

        If the device has begun its time anew, the seconds go on as if this message had been as long on its
        way as the one before.
        """
        self.restart = ""
        if time < self._last:
            if self._wraps_at is not None and self._last - time > self._wraps_at / 2:
                self._offset_s += self._wraps_at * self._unit_s
            else:
                self.restart = (
                    f"a clock that went back from {self._last * self._unit_s:g} to {time * self._unit_s:g} s"
                )
                way_s = self._arrived_s - self._last_s
                self._offset_s = arrived_s - way_s - time * self._unit_s
        self._last, self._arrived_s = time, arrived_s
        self._last_s = time * self._unit_s + self._offset_s
        return self._last_s
