"""The newest values of all signals of a rig, and what they did since the last reading."""

import threading
from collections import deque
from collections.abc import Sequence

import numpy as np

from drivers.signals import Signal
from rig.samples import SignalReading, TimedSamples

_KEPT_S = 10.0
"""Samples are kept for this time in s for a reader that comes late."""


class Readings:
    """Keeps the samples of one device until they are read. Any thread may call all methods.

    `signals` are the signals in the order of the samples.
    """

    def __init__(self, signals: Sequence[Signal]) -> None:
        self._signals = tuple(signals)
        self._waiting: deque[TimedSamples] = deque()
        self._newest: TimedSamples | None = None
        self._lock = threading.Lock()

    def add(self, samples: TimedSamples) -> None:
        """Keep samples for the next reading."""
        with self._lock:
            self._newest = samples
            self._waiting.append(samples)
            while samples.time_s[-1] - self._waiting[0].time_s[-1] > _KEPT_S:
                self._waiting.popleft()

    def take(self) -> dict[str, SignalReading]:
        """Return what every signal did since the last call; nothing before the first sample."""
        with self._lock:
            if self._newest is None:
                return {}
            new = list(self._waiting)
            self._waiting.clear()
            values = np.concatenate([each.values for each in new]) if new else self._newest.values[-1:]
            time_s = np.concatenate([each.time_s for each in new]) if new else self._newest.time_s[-1:]
        return {
            signal.name: SignalReading(values[:, k], time_s - signal.delay_s, bool(new), signal.unit)
            for k, signal in enumerate(self._signals)
        }
