"""Estimate how long the motion or the hold of each step takes."""

import math
from collections.abc import Sequence

from rig.protocol.step import ProtocolStep


def motion_times_s(steps: Sequence[ProtocolStep], speed_deg_s: float | None) -> list[float | None]:
    """Return for each step the time in s from the end of the previous step to the images, without the dwell.

    A time is None if the speed of the stage is unknown.
    """
    times_s: list[float | None] = []
    at_s = 0.0
    for step in steps:
        at_s = 0.0 if step.begins else at_s
        if step.timed:
            times_s.append(step.at_s - at_s)
            at_s = step.at_s
        else:
            times_s.append(_travel_s(step, speed_deg_s))
    return times_s


def _travel_s(step: ProtocolStep, speed_deg_s: float | None) -> float | None:
    if math.isnan(step.travel):
        return 0.0
    if step.kind == "rotation":
        return None if speed_deg_s is None else step.travel / speed_deg_s
    return step.travel / step.rate
