"""When a frame of a GenICam camera was exposed: from its arrival, or from the camera's own time stamp."""

import math
from dataclasses import dataclass

from drivers.cameras.genicam.settings import GenicamSettings
from drivers.cameras.middle import middle_of_arrival, middle_of_start
from drivers.errors import DeviceFault


@dataclass(frozen=True)
class Times:
    """Earliest start of an exposure, its middle and the middle's standard deviation; see `Frame`."""

    exposed_s: float
    middle_s: float
    middle_std_s: float


def require_past(times: Times, received_s: float, device: str) -> Times:
    """Return the times of a frame; raise `DeviceFault` if the middle of its exposure is after its arrival."""
    if times.middle_s > received_s:
        raise DeviceFault(
            device,
            "get frame",
            "a frame from the past",
            f"one whose exposure lies {times.middle_s - received_s:.3f} s after its arrival",
            'correct `stamp`, or use "arrival": the camera\'s time stamps do not mark this',
        )
    return times


class StampRule:
    """Computes the times of a frame from what its time stamp marks.

    If the exposure time is unknown, one frame time is assumed, so that the age of a frame is never
    underestimated, and the middle stays unknown.

    Parameters
    ----------
    settings : GenicamSettings
    exposure_us : float
        Exposure time in µs as read back from the camera; NaN if it is unknown.
    """

    def __init__(self, settings: GenicamSettings, exposure_us: float) -> None:
        self._exposure_s = exposure_us * 1e-6
        self._longest_s = 1 / settings.rate_hz if math.isnan(exposure_us) else self._exposure_s
        self._transfer_s = settings.transfer_s
        self._at_start = settings.stamp == "start"

    def of_arrival(self, arrived_s: float, earliest_s: float) -> Times:
        """Return the times of a frame that arrived between `earliest_s` and `arrived_s`.

        Both are in seconds on the rig's clock. They are equal if the arrival itself was stamped.
        """
        transfer_s = self._transfer_s + arrived_s - earliest_s
        middle = middle_of_arrival(arrived_s, self._exposure_s, transfer_s)
        return Times(earliest_s - self._transfer_s - self._longest_s, *middle)

    def of_camera(self, stamped_s: float, half_s: float) -> Times:
        """Return the times of a frame that the camera stamped at `stamped_s`, give or take `half_s`.

        Both are in seconds on the rig's clock. The error is taken as uniformly distributed.
        """
        longest_s, length_s = (0.0, 0.0) if self._at_start else (self._longest_s, self._exposure_s)
        middle = middle_of_start(stamped_s - length_s, self._exposure_s, half_s / math.sqrt(3.0))
        return Times(stamped_s - half_s - longest_s, *middle)
