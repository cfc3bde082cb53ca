"""The times at which a simulated camera exposes, and the frames of a camera that films by itself."""

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime

import numpy as np
from numpy.typing import NDArray

from drivers.clock import Clock
from drivers.interfaces import Frame
from simulators.rig.picture_faults import Taken
from simulators.scene.between import Look
from simulators.scene.scene import Surface

LOOKS = (0.0, 0.5, 1.0)
"""Parts of an exposure at which the camera looks at the scene."""


@dataclass(frozen=True)
class TimedLook(Look):
    """What a camera saw, and the standard deviation of the time, in s, because looking takes time."""

    std_s: float


@dataclass(frozen=True)
class Beat:
    """The times at which exposures start: frame `first` starts at `first_s`, then one every `interval_s`.

    The times are in seconds on the rig's clock.
    """

    first: int
    first_s: float
    interval_s: float

    def start_s(self, number: int) -> float:
        """Return the start of the exposure of frame `number`."""
        return self.first_s + (number - self.first) * self.interval_s

    def next(self, now_s: float) -> int:
        """Return the number of the first frame that starts at `now_s` or later, and not before `first`."""
        number = max(self.first, self.first + math.floor((now_s - self.first_s) / self.interval_s))
        while self.start_s(number) < now_s:
            number += 1
        return number


@dataclass(frozen=True)
class Exposure:
    """An exposed picture that the camera still has to read out.

    Attributes
    ----------
    taken : Taken
        Number, and true beginning and length.
    middle_s, middle_std_s : float
        True middle, and its standard deviation: see `drivers.interfaces.Frame`.
    utc : datetime
        Of the true beginning.
    surface : Surface
        What the camera saw in the middle of the exposure.
    image : ndarray of uint8 or uint16, shape (height, width)
    arrives_s : float
        Time at which the program receives the frame, in seconds on the rig's clock.
    faults : tuple of str
        Names of the faults that the picture shows.
    late_s : float
        Time from the beginning that was meant to the true one.
    """

    taken: Taken
    middle_s: float
    middle_std_s: float
    utc: datetime
    surface: Surface
    image: NDArray[np.uint8] | NDArray[np.uint16]
    arrives_s: float
    faults: tuple[str, ...] = ()
    late_s: float = 0.0


@dataclass(frozen=True)
class Start:
    """The start of exposure `number`: at `begins_s`, which is `late_s` after the time that was meant."""

    number: int
    begins_s: float
    late_s: float = 0.0


class Film:
    """The frames of a camera that exposes at each beat, whether or not somebody asks for them.

    A picture may still be read out while the next one is exposed. If drawing a picture takes longer than a
    beat in real time, the pictures whose middle has passed meanwhile are lost, and their numbers are missing.

    Parameters
    ----------
    clock : Clock
    beat : Beat
    exposure_s : float
    start : callable
        ``start(number)`` returns the start of an exposure.
    look : callable
        ``look()`` is called at the start, in the middle and at the end of an exposure.
    develop : callable
        ``develop(start, looks)`` is called at the end of an exposure, and returns None for a lost picture.
    read_out : callable
        ``read_out(exposure)`` returns the frame when it has arrived.
    """

    def __init__(
        self,
        clock: Clock,
        beat: Beat,
        exposure_s: float,
        *,
        start: Callable[[int], Start],
        look: Callable[[], TimedLook],
        develop: Callable[[Start, list[TimedLook]], Exposure | None],
        read_out: Callable[[Exposure], Frame],
    ) -> None:
        self._clock = clock
        self._beat = beat
        self._exposure_s = exposure_s
        self._begin, self._look = start, look
        self._develop, self._read_out = develop, read_out
        self._start = start(beat.next(clock.now_s()))
        self._looks: list[TimedLook] = []
        self._exposed: deque[Exposure] = deque()

    def next_frame(self, timeout_s: float) -> Frame | None:
        """Return the next frame, or None if none arrives within `timeout_s` seconds."""
        deadline_s = self._clock.now_s() + timeout_s
        while True:
            look_s = self._start.begins_s + LOOKS[len(self._looks)] * self._exposure_s
            arrives_s = self._exposed[0].arrives_s if self._exposed else math.inf
            event_s = min(look_s, arrives_s)
            self._clock.sleep(min(event_s, deadline_s) - self._clock.now_s())
            if event_s > deadline_s:
                return None
            if arrives_s <= look_s:
                return self._read_out(self._exposed.popleft())
            self._looks.append(self._look())
            if len(self._looks) == len(LOOKS):
                self._finish()

    def _finish(self) -> None:
        """Draw the picture of the exposure that is over, and turn to the next one."""
        looks, self._looks = self._looks, []
        exposure = self._develop(self._start, looks)
        if exposure is not None:
            self._exposed.append(exposure)
        number = self._start.number + 1
        self._start = self._begin(max(number, self._beat.next(self._clock.now_s() - self._exposure_s / 2)))
