"""Find the images of a triggered camera that did not come, because a trigger line or its cable is broken."""

import math
from collections import deque
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

_REGULAR = 8
"""Triggers are regular if none of this number of times between two frames is much longer than the others."""
_MUCH = 3.0
_DEADLINE_INTERVALS, _DEADLINE_LEAST_S = 10.0, 1.0


class RegularTriggers:
    """The frames of a camera that takes one at each trigger of another device.

    Nobody knows when a trigger is due, so silence is no fault. But if the triggers have come regularly and
    then none comes for the longest time between two of them and a deadline, frames are missing. The deadline
    is ten times between two triggers, at least 1 s and at most `timeout_s`.
    """

    def __init__(self, timeout_s: float) -> None:
        self._timeout_s = timeout_s
        self._times_s: deque[float] = deque(maxlen=_REGULAR + 1)
        self._told = 0

    def see(self, time_s: float) -> None:
        """Note a frame by the middle of its exposure."""
        if self._told:
            # the time without triggers is none between two of them
            self._times_s.clear()
            self._told = 0
        self._times_s.append(time_s)

    def missing(self, now_s: float) -> int:
        """Return how many frames are missing that were not told before, if none came until `now_s`."""
        if len(self._times_s) <= _REGULAR:
            return 0
        intervals_s = [later - earlier for earlier, later in pairwise(self._times_s)]
        usual_s, longest_s = float(np.median(intervals_s)), max(intervals_s)
        deadline_s = min(self._timeout_s, max(_DEADLINE_LEAST_S, _DEADLINE_INTERVALS * usual_s))
        silent_s = now_s - self._times_s[-1]
        if longest_s > _MUCH * usual_s or silent_s <= longest_s + deadline_s:
            return 0
        new = math.floor(silent_s / usual_s) - self._told
        self._told += new
        return new


def sentence(camera: str, missing: int, given_by: Sequence[str]) -> str:
    """Return what a person is told of the missing images of a triggered camera.

    `given_by` are the names of the rig's outputs that give a pulse at each exposure.
    """
    images = "1 image is" if missing == 1 else f"{missing} images are"
    outputs = "".join(f", the output triggers.{name}" for name in given_by)
    source = outputs or ", the device that gives the triggers"
    return (
        f"cameras.{camera}: {images} missing, because no trigger gave a frame; check the camera's trigger "
        f"line (cameras.{camera}.trigger), its cable{source}"
    )
