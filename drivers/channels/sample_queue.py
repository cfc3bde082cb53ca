"""Samples that came by themselves and wait to be read, with their numbers and times."""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivers.channels.settings import ChannelSettings
from drivers.signals import Samples


class RestartedError(Exception):
    """Raised once before the first sample after a restart of the device. The text tells what went back."""


@dataclass(frozen=True)
class _Waiting:
    number: int
    inputs: Sequence[float]
    earliest_s: float
    arrived_s: float
    device_s: float
    restart: str


class SampleQueue:
    """Samples in the order of their arrival. `has_time` tells whether the device has a clock of its own."""

    def __init__(self, settings: ChannelSettings, *, has_time: bool) -> None:
        self._settings = settings
        self._has_time = has_time
        self._waiting: deque[_Waiting] = deque()
        self._next = 0

    def __len__(self) -> int:
        return len(self._waiting)

    def lose(self, count: int = 1) -> None:
        """Leave a gap in the numbers of the samples, but none before the first."""
        self._next += count if self._next else 0

    def add(
        self,
        inputs: Sequence[float],
        earliest_s: float,
        arrived_s: float,
        device_s: float = math.nan,
        restart: str = "",
    ) -> None:
        """Append a sample.

        `inputs` is what the device delivered for each signal. The sample arrived at `arrived_s`, and was not
        measured before `earliest_s`, on the rig's clock. `restart` tells that the device was restarted before
        the sample, or is empty.
        """
        self._waiting.append(_Waiting(self._next, inputs, earliest_s, arrived_s, device_s, restart))
        self._next += 1

    def take(self) -> Samples:
        """Return the next sample, or all consecutive ones if they have times of their own.

        Raise `RestartedError` once before the first sample after a restart.
        """
        first = self._waiting[0]
        if first.restart:
            self._waiting[0] = replace(first, restart="")
            raise RestartedError(first.restart)
        taken = [self._waiting.popleft()]
        while self._has_time and self._waiting:
            follower = self._waiting[0]
            if follower.restart or follower.number != taken[-1].number + 1:
                break
            taken.append(self._waiting.popleft())
        return Samples(
            self._settings.in_units(np.array([each.inputs for each in taken])),
            first.number,
            taken[-1].arrived_s,
            -math.inf if self._has_time else first.earliest_s,
            np.array([each.device_s for each in taken]) if self._has_time else None,
        )
