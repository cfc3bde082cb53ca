"""Start of exposure and number of a frame, from the kernel's timestamps and counters."""

import math
from dataclasses import dataclass

from drivers.cameras.v4l2.abi import BufferFlag
from drivers.cameras.v4l2.buffers import Filled
from drivers.errors import DeviceFault

COUNTER = 2**32
STAMPED_ON_ARRIVAL = ("uvcvideo",)
"""Kernel drivers that flag the timestamp as start of exposure but record the arrival of the first packet."""


def require_monotonic(flags: int, device: str) -> None:
    """Raise `DeviceFault` unless the timestamp comes from the monotonic clock."""
    if flags & BufferFlag.CLOCK != BufferFlag.MONOTONIC:
        raise DeviceFault(
            device,
            "get frame",
            "a stamp of the monotonic clock",
            f"flags {flags:#x}",
            "use another camera: this one's driver cannot tell how old a frame is",
        )


@dataclass(frozen=True)
class StampRule:
    """Converts the timestamp of a frame to the earliest possible start of its exposure.

    The age of a frame is never underestimated: an unknown delay counts as a whole frame time.

    Attributes
    ----------
    started_s : float
        Longest time from the start of exposure to a timestamp that marks the start of the frame.
    ended_s : float
        Longest time from the start of exposure to a timestamp that marks the end of the frame.
    """

    started_s: float
    ended_s: float

    @classmethod
    def of(cls, driver: str, exposure_us: float, transfer_us: float | None, interval_s: float) -> "StampRule":
        """Return the rule for a camera.

        Parameters
        ----------
        driver : str
            The kernel's driver.
        exposure_us : float
            NaN if unknown; the exposure then counts as one interval.
        transfer_us : float, optional
            Longest time from the end of exposure to the timestamp; one interval by default.
        interval_s : float
        """
        exposure_s = interval_s if math.isnan(exposure_us) else exposure_us * 1e-6
        readout_s = interval_s if transfer_us is None else transfer_us * 1e-6
        ended_s = exposure_s + readout_s
        # The camera sends the first packet only after the exposure of the first row.
        return cls(ended_s if driver in STAMPED_ON_ARRIVAL else 0.0, ended_s)

    def exposed_s(self, filled: Filled) -> float:
        """Return the earliest possible start of exposure of the frame in a buffer."""
        at_start = filled.flags & BufferFlag.STAMP_PLACE == BufferFlag.STAMP_AT_START
        return filled.stamp_s - (self.started_s if at_start else self.ended_s)


class FrameNumbers:
    """Continues the kernel's 32-bit frame counter beyond overflows and restarts.

    Parameters
    ----------
    interval_s : float
        Time between frames; gives the number of missing frames after a restart of the stream.
    """

    def __init__(self, interval_s: float) -> None:
        self._interval_s = interval_s
        self._last: tuple[int, float] | None = None
        self._number = 0
        self._restarted = False

    def restarted(self) -> None:
        """Note that the kernel counts from 0 again."""
        self._restarted = True

    def number(self, counter: int, stamp_s: float) -> int:
        """Return the frame's number; repeated or decreasing counter values are kept as such."""
        if self._last is None:
            self._number = counter
        elif self._restarted:
            self._number += max(1, round((stamp_s - self._last[1]) / self._interval_s))
        else:
            self._number += (counter - self._last[0] + COUNTER // 2) % COUNTER - COUNTER // 2
        self._restarted = False
        self._last = counter, stamp_s
        return self._number
