"""Which frames of several cameras are measured together: those that were exposed at the same time."""

import math
from collections import deque
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise

_KEPT = 4
"""Frames of a camera that wait for those of other cameras."""

_INTERVALS = 9
_LATE = 1.5
"""A camera counts as missing when its next frame is due since half an interval."""

_MARGIN_S = 0.02
_FIRST_S = 1.0
"""A camera that has not delivered two frames is awaited for this time in s."""


@dataclass(frozen=True)
class Arrival:
    """A frame of a camera that has arrived.

    Attributes
    ----------
    number : int
        Number of the frame among those of its camera that were offered, from 1.
    time_s, time_std_s : float
        The middle of the exposure, and its standard deviation.
    sequence : int
        The camera's own number of the frame.
    """

    number: int
    time_s: float
    time_std_s: float = 0.0
    sequence: int = 0


@dataclass(frozen=True)
class Together:
    """Frames to measure together, by camera, and why the other cameras have none."""

    frames: Mapping[str, Arrival]
    missing: Mapping[str, str] = field(default_factory=dict)


def middle_of(arrivals: Collection[Arrival]) -> tuple[float, float]:
    """Return the time of frames that are measured together, and its standard deviation.

    Half the time between them counts as a standard deviation, because each camera has its own instant.
    """
    times = [each.time_s for each in arrivals]
    stds = [each.time_std_s for each in arrivals if not math.isnan(each.time_std_s)]
    variance = sum(std**2 for std in stds) / len(arrivals)
    return sum(times) / len(times), math.hypot(math.sqrt(variance), (max(times) - min(times)) / 2)


class _Camera:
    def __init__(self, since_s: float) -> None:
        self.waiting: deque[Arrival] = deque(maxlen=_KEPT)
        self.since_s = since_s
        self.interval_s = math.nan
        """The middle one of the last intervals between frames; NaN before two frames."""
        self.missing_from_s = since_s + _FIRST_S
        """The time from which the camera is missing if no further frame comes."""
        self._times_s: deque[float] = deque(maxlen=_INTERVALS)

    def arrived(self, arrival: Arrival, now_s: float) -> bool:
        """Take note of a frame; return False if the camera was opened again, or its clock was set."""
        self.waiting.append(arrival)
        goes_on = not self._times_s or arrival.time_s > self._times_s[-1]
        if goes_on:
            self._times_s.append(arrival.time_s)
        else:
            self._times_s.clear()
        self.since_s = now_s
        apart = sorted(after - before for before, after in pairwise(self._times_s))
        self.interval_s = apart[len(apart) // 2] if apart else math.nan
        self.missing_from_s = now_s + (_LATE * self.interval_s + _MARGIN_S if apart else _FIRST_S)
        return goes_on


class Pairing:
    """Chooses the frames that are measured next: the newest that were exposed at the same time.

    Frames of two cameras belong together if they are at most half an interval apart, that of the slower
    camera. A frame waits for that of another camera as long as this one may still come. A camera that is
    missing holds up no other one.

    Parameters
    ----------
    cameras : iterable of str
    now_s : float
        Time at which the cameras begin.
    """

    def __init__(self, cameras: Iterable[str], now_s: float) -> None:
        self._cameras = {name: _Camera(now_s) for name in cameras}
        self._last_s = -math.inf
        """The time of the frames that were measured last."""

    def arrived(self, camera: str, arrival: Arrival, now_s: float) -> None:
        """Take note of a frame."""
        if not self._cameras[camera].arrived(arrival, now_s):
            self._last_s = -math.inf

    def gone(self, camera: str, before: int) -> None:
        """Forget frames of a camera with smaller numbers, because newer ones have taken their places."""
        waiting = self._cameras[camera].waiting
        while waiting and waiting[0].number < before:
            waiting.popleft()

    def next(self, now_s: float) -> Together | None:
        """Return the frames to measure now, None if there is nothing to measure yet.

        Older frames are not measured any more, so the times of what is measured increase.
        """
        waiting = {name: each for name, each in self._cameras.items() if each.waiting}
        present = {name: each for name, each in self._cameras.items() if each.missing_from_s > now_s}
        if not waiting or present.keys() - waiting.keys():
            return None
        chosen = self._nearest(waiting) or self._without_others(waiting, present)
        if chosen is None:
            return None
        for name, arrival in chosen.items():
            self.gone(name, arrival.number + 1)
        time_s, _ = middle_of(chosen.values())
        if time_s <= self._last_s:
            # It was left over beside a later frame of another camera, or came too late.
            return self.next(now_s)
        self._last_s = time_s
        others = self._cameras.keys() - chosen.keys()
        return Together(chosen, {name: self._why(name, now_s) for name in sorted(others)})

    @property
    def newest_waiting(self) -> dict[str, Arrival]:
        """The newest frame of each camera whose frames wait for those of another one."""
        return {name: each.waiting[-1] for name, each in self._cameras.items() if each.waiting}

    def waits_s(self, now_s: float) -> float:
        """Return the time in s after which a camera may be missing for which frames wait; inf without one."""
        if not any(each.waiting for each in self._cameras.values()):
            return math.inf
        dues = [each.missing_from_s for each in self._cameras.values() if each.missing_from_s > now_s]
        return max(0.0, min(dues, default=math.inf) - now_s)

    def _nearest(self, waiting: Mapping[str, _Camera]) -> dict[str, Arrival] | None:
        """Return the newest frames of all these cameras that belong together, None if there are none."""
        intervals = [each.interval_s for each in waiting.values()]
        apart_s = math.inf if any(map(math.isnan, intervals)) else max(intervals) / 2
        (first, camera), *others = waiting.items()
        for arrival in reversed(camera.waiting):
            chosen = {first: arrival}
            for name, other in others:
                chosen[name] = min(other.waiting, key=lambda each: abs(each.time_s - arrival.time_s))
            times = [each.time_s for each in chosen.values()]
            if max(times) - min(times) <= apart_s:
                return chosen
        return None

    def _without_others(
        self, waiting: Mapping[str, _Camera], present: Mapping[str, _Camera]
    ) -> dict[str, Arrival] | None:
        """Return frames without those of cameras that are missing, or whose times never fit."""
        if len(present) < len(waiting):
            if present:
                return self._nearest(present)
            name, camera = max(waiting.items(), key=lambda each: each[1].waiting[-1].time_s)
            return {name: camera.waiting[-1]}
        full = [name for name, each in waiting.items() if len(each.waiting) == _KEPT]
        return {full[0]: waiting[full[0]].waiting[-1]} if full else None

    def _why(self, name: str, now_s: float) -> str:
        camera = self._cameras[name]
        if camera.waiting or camera.missing_from_s > now_s:
            return "its frames were exposed at other times"
        return f"no frame for {now_s - camera.since_s:.2f} s"
