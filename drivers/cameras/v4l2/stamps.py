"""Compute start, middle and number of an exposure from the kernel's timestamp and counter."""

import math
from dataclasses import dataclass

from drivers.cameras.middle import middle_of_arrival, middle_of_start
from drivers.cameras.v4l2.abi import BufferFlag
from drivers.cameras.v4l2.buffers import Filled
from drivers.errors import DeviceFault

COUNTER = 2**32
STAMPED_ON_ARRIVAL = ("uvcvideo",)
"""Kernel drivers that record the arrival of the first packet but flag the timestamp as start of exposure."""


def require_monotonic(flags: int, device: str) -> None:
    """Raise `DeviceFault` if a timestamp does not come from the monotonic clock."""
    if flags & BufferFlag.CLOCK != BufferFlag.MONOTONIC:
        raise DeviceFault(
            device,
            "get frame",
            "a timestamp of the monotonic clock",
            f"flags {flags:#x}",
            "use another camera: this one's driver cannot tell how old a frame is",
        )


@dataclass(frozen=True)
class StampRule:
    """Converts the timestamp of a frame to the earliest possible start of its exposure, and to its middle.

    An unknown delay counts as one frame time, so that the age of a frame is never underestimated. Three kinds
    of stamps are known. Some drivers of the kernel stamp the start of exposure: the middle is half an
    exposure later. Others stamp the end of the frame, and ``uvcvideo`` stamps the first packet, which comes
    after the exposure of the first row: the exposure ended at an unknown moment within the transfer time
    before the stamp.
    """

    # longest time from the start of exposure to a timestamp that marks the start of the frame
    started_s: float
    ended_s: float  # longest time from the start of exposure to a timestamp that marks the end of the frame
    exposure_s: float  # NaN if unknown
    transfer_s: float  # longest time from the end of exposure to a timestamp after it

    @classmethod
    def of(cls, driver: str, exposure_us: float, transfer_us: float | None, interval_s: float) -> "StampRule":
        """Return the rule for a camera.

        `driver` is the name of the kernel driver. `exposure_us` is the exposure time in µs. For NaN
        (unknown), one frame interval is assumed. `transfer_us` is the longest time, in µs, from the end of
        exposure to the timestamp. The default is one frame interval. `interval_s` is the time between two
        frames, in seconds.
        """
        exposure_s = interval_s if math.isnan(exposure_us) else exposure_us * 1e-6
        readout_s = interval_s if transfer_us is None else transfer_us * 1e-6
        ended_s = exposure_s + readout_s
        # The camera sends the first packet only after the exposure of the first row has ended.
        started_s = ended_s if driver in STAMPED_ON_ARRIVAL else 0.0
        return cls(started_s, ended_s, exposure_us * 1e-6, readout_s)

    def exposed_s(self, filled: Filled) -> float:
        """Return the earliest possible start of exposure of the frame in a buffer, in seconds."""
        return filled.stamp_s - (self.started_s if _at_start(filled) else self.ended_s)

    def middle(self, filled: Filled) -> tuple[float, float]:
        """Return the middle of the exposure of the frame in a buffer, and its standard deviation, in seconds.

        Both are NaN if the exposure time is unknown.
        """
        if _at_start(filled) and self.started_s == 0.0:
            return middle_of_start(filled.stamp_s, self.exposure_s)
        return middle_of_arrival(filled.stamp_s, self.exposure_s, self.transfer_s)


def _at_start(filled: Filled) -> bool:
    return filled.flags & BufferFlag.STAMP_PLACE == BufferFlag.STAMP_AT_START


class FrameNumbers:
    """Frame numbers that continue when the kernel's 32-bit counter overflows, and after `restarted`.

    `interval_s` is the time between two frames, in seconds. After a restart of filming, this time gives the
    number of missing frames.
    """

    def __init__(self, interval_s: float) -> None:
        self._interval_s = interval_s
        self._last: tuple[int, float] | None = None
        self._number = 0
        self._restarted = False

    def restarted(self) -> None:
        """Record that the kernel's counter has restarted from 0."""
        self._restarted = True

    def number(self, counter: int, stamp_s: float) -> int:
        """Return the number of a frame, which repeats or decreases when the kernel's counter does so."""
        if self._last is None:
            self._number = counter
        elif self._restarted:
            self._number += max(1, round((stamp_s - self._last[1]) / self._interval_s))
        else:
            self._number += (counter - self._last[0] + COUNTER // 2) % COUNTER - COUNTER // 2
        self._restarted = False
        self._last = counter, stamp_s
        return self._number
