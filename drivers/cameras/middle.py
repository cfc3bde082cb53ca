"""The middle of an exposure and its standard deviation, from what a time stamp marks."""

import math

STAMP_STD_S = 5e-4
"""Assumed standard deviation of the time, in seconds, at which a computer stamps an event.

Interrupts and the turns of a USB bus make a stamp late by less than a millisecond. Nobody has measured this
with your camera; `rig check` measures the delay of a camera against a channel.
"""

UNKNOWN = (math.nan, math.nan)
"""The middle and its standard deviation if the driver knows no better than the limits of a frame's times."""


def middle_of_arrival(arrived_s: float, exposure_s: float, transfer_s: float) -> tuple[float, float]:
    """Return the middle of an exposure that ended before the frame arrived.

    The frame arrives between 0 and `transfer_s` seconds after the end of its exposure, and nothing tells
    when. The time between is taken as uniformly distributed. This includes the readout of the rows of a
    rolling shutter, whose middle row is exposed later than its first one.

    Parameters
    ----------
    arrived_s : float
        The time stamp, which marks the arrival or the end of the frame.
    exposure_s : float
        Exposure time; NaN if it is unknown. The middle is then unknown too.
    transfer_s : float
        Longest time from the end of the exposure to the time stamp.
    """
    if math.isnan(exposure_s):
        return UNKNOWN
    std_s = math.hypot(transfer_s / math.sqrt(12.0), STAMP_STD_S)
    return arrived_s - exposure_s / 2 - transfer_s / 2, std_s


def middle_of_start(begun_s: float, exposure_s: float, std_s: float = STAMP_STD_S) -> tuple[float, float]:
    """Return the middle of an exposure whose start is stamped with the standard deviation `std_s`.

    With a rolling shutter, this is the middle of the row that the stamp belongs to, mostly the first one.
    """
    if math.isnan(exposure_s):
        return UNKNOWN
    return begun_s + exposure_s / 2, std_s
