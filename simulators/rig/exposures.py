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
from simulators.scene.scene import Surface


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
    number : int
    exposed_s, middle_s, middle_std_s : float
        See `drivers.interfaces.Frame`.
    utc : datetime
    surface : Surface
        What the camera saw in the middle of the exposure.
    image : ndarray of uint8 or uint16, shape (height, width)
    arrives_s : float
        Time at which the program receives the frame, in seconds on the rig's clock.
    """

    number: int
    exposed_s: float
    middle_s: float
    middle_std_s: float
    utc: datetime
    surface: Surface
    image: NDArray[np.uint8] | NDArray[np.uint16]
    arrives_s: float


class Film:
    """The frames of a camera that exposes at each beat, whether or not somebody asks for them.

    A picture may still be read out while the next one is exposed. If drawing a picture takes longer than a
    beat in real time, the pictures whose middle has passed meanwhile are lost, and their numbers are missing.

    Parameters
    ----------
    clock : Clock
    beat : Beat
    middle_s : float
        Time from the start of an exposure to its middle, in seconds.
    expose : callable
        ``expose(number, begun_s)`` is called in the middle of an exposure, with the time of its start. It
        returns None for a lost picture.
    read_out : callable
        ``read_out(exposure)`` returns the frame when it has arrived.
    """

    def __init__(
        self,
        clock: Clock,
        beat: Beat,
        middle_s: float,
        expose: Callable[[int, float], Exposure | None],
        read_out: Callable[[Exposure], Frame],
    ) -> None:
        self._clock = clock
        self._beat = beat
        self._middle_s = middle_s
        self._expose = expose
        self._read_out = read_out
        self._next = beat.next(clock.now_s())
        self._exposed: deque[Exposure] = deque()

    def next_frame(self, timeout_s: float) -> Frame | None:
        """Return the next frame, or None if none arrives within `timeout_s` seconds."""
        deadline_s = self._clock.now_s() + timeout_s
        while True:
            begins_s = self._beat.start_s(self._next)
            middle_s = begins_s + self._middle_s
            arrives_s = self._exposed[0].arrives_s if self._exposed else math.inf
            event_s = min(middle_s, arrives_s)
            self._clock.sleep(min(event_s, deadline_s) - self._clock.now_s())
            if event_s > deadline_s:
                return None
            if arrives_s <= middle_s:
                return self._read_out(self._exposed.popleft())
            exposure = self._expose(self._next, begins_s)
            if exposure is not None:
                self._exposed.append(exposure)
            self._next = max(self._next + 1, self._beat.next(self._clock.now_s() - self._middle_s))
