"""The images of all cameras at the times of an acquisition."""

import math
from collections import deque
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field

from drivers.errors import DeviceError
from drivers.interfaces import Frame
from rig.engine.context import RunContext
from rig.engine.devices import CameraLost
from rig.engine.feeds import GrabFeed, StreamFeed, Taken, feed_of
from rig.engine.imaging import RETURNS_MAX, StepImages
from rig.engine.timing import Timing
from rig.engine.trigger_faults import sentence
from rig.errors import RigError
from rig.protocol.step import RigReading

_RETURNS_S = 600.0
"""A camera may drop out `RETURNS_MAX` times within this time in s. More mean a bad cable or power supply."""
_PAIR_SHARE = 0.6
"""Frames of two cameras belong together if they are this part of the shortest time between two frames apart.
Half of it would lose a pair at every tiny error of the times of cameras that run freely."""


@dataclass
class Shot:
    """One time at which all cameras take an image. `reading` is the one after which it was asked for."""

    due_s: float
    reading: RigReading
    taken: dict[str, Taken] = field(default_factory=dict)

    @property
    def frames(self) -> Mapping[str, Frame]:
        """The images by camera."""
        return {name: taken for name, taken in self.taken.items() if isinstance(taken, Frame)}

    @property
    def is_whole(self) -> bool:
        """True if no camera has missed its image."""
        return len(self.frames) == len(self.taken)


class Shots:
    """Asks all cameras for images, and collects them. A camera that fails is opened again.

    `timing` counts the images. An image that is more than `tolerance_s` off its time is late. With
    `every_frame`, one camera leads: each of its frames is an image, and the other cameras are asked for the
    frames nearest to it. It is the first camera that is triggered, or the first one with a stream.
    """

    def __init__(
        self, run: RunContext, images: StepImages, timing: Timing, *, every_frame: bool = False
    ) -> None:
        self._run, self._images, self._timing = run, images, timing
        self._every_frame = every_frame
        self._leading = ""
        self._begun_s = math.inf
        self._last_s = math.nan
        self._feeds: dict[str, GrabFeed | StreamFeed] = {}
        self._open: deque[Shot] = deque()
        self._silent: dict[str, int] = {}
        self._returns_s: deque[float] = deque(maxlen=RETURNS_MAX + 1)
        self._ready_s = 0.0

    @property
    def waits(self) -> bool:
        """True while images that were asked for are not taken."""
        return bool(self._open)

    def open(self) -> None:
        """Open the streams of the cameras. Raise `DeviceError` if a camera fails."""
        run, timing = self._run, self._timing
        self._images.begin_numbers_anew()
        for name, camera in self._images.cameras.items():
            timeout_s = run.protocol.images.timeout_s
            tolerance_s = timing.tolerance_s
            self._feeds[name] = feed_of(camera, run.clock, timeout_s, tolerance_s, run.live.offer)
        self._ready_s = run.clock.now_s()
        if not math.isnan(self._last_s):
            # no frame of the time without streams is missing twice, or at all if it is that of a pause
            self._last_s = self._ready_s
        if self._every_frame:
            self._choose_leader()

    def begin(self, begun_s: float) -> None:
        """With `every_frame`, take all frames that are exposed from a time on."""
        self._begun_s = begun_s
        if self._every_frame:
            self._leader[1].give_all_from(max(begun_s, self._ready_s))

    def take_frames(self, reading: RigReading, most: int, until_s: float) -> bool:
        """Take the frames of the leading camera up to a time, and ask the other cameras for theirs.

        Not more than `most` images are asked for. Return True if a frame after `until_s` has come.
        """
        name, leader = self._leader
        others = [feed for other, feed in self._feeds.items() if other != name]
        room = min((feed.most_open for feed in others), default=most)
        while self._timing.asked < most and len(self._open) < room:
            try:
                frame = leader.take_next()
            except DeviceError as error:
                self._bring_back(name, error)
                return False
            if frame is None:
                self._miss_triggers(leader.untriggered())
                return False
            due_s = self._last_s = frame.middle[0]
            if due_s > until_s:
                return True
            self._timing.ask()
            self._run.pulses.give("exposure")
            self._open.append(Shot(due_s, reading, {name: frame}))
            for feed in others:
                feed.ask(due_s)
        return False

    @property
    def _leader(self) -> tuple[str, StreamFeed]:
        name = self._leading
        feed = self._feeds[name]
        assert isinstance(feed, StreamFeed)
        return name, feed

    def _choose_leader(self) -> None:
        streams = {name: feed for name, feed in self._feeds.items() if isinstance(feed, StreamFeed)}
        if not streams:
            raise RigError(
                "acquire.every_frame",
                "a camera whose driver has a stream",
                f"{', '.join(self._feeds)} without one",
                "use a camera with a stream, or another key of [acquire]",
            )
        triggered = [name for name, feed in streams.items() if feed.is_triggered]
        self._leading = next(iter([*triggered, *streams]))
        leader_s = streams[self._leading].shortest_s
        for name, feed in streams.items():
            shortest_s = max(leader_s, feed.shortest_s)
            if name != self._leading and not math.isnan(leader_s + feed.shortest_s):
                feed.pairs_within_s = _PAIR_SHARE * shortest_s
        if self._begun_s < math.inf:
            self.begin(self._begun_s)

    @property
    def are_ready(self) -> bool:
        """True if each stream has delivered a frame."""
        return all(feed.is_ready for feed in self._feeds.values())

    def ask(self, due_s: float, reading: RigReading) -> None:
        """Ask all cameras for an image, or count it as missing if they are too slow."""
        self._timing.ask()
        # No camera has an image of a time at which its stream was not open, because a camera was lost.
        too_early = due_s < self._ready_s - self._timing.tolerance_s
        if too_early or len(self._open) >= min(feed.most_open for feed in self._feeds.values()):
            self._timing.miss()
            return
        self._run.pulses.give("exposure")
        self._open.append(Shot(due_s, reading))
        for feed in self._feeds.values():
            feed.ask(due_s)

    def poll(self) -> list[Shot]:
        """Take what the cameras have delivered, and return the times at which all of them have an image."""
        self._run.pulses.check()
        for name, feed in self._feeds.items():
            try:
                while (taken := feed.take()) is not None:
                    next(shot for shot in self._open if name not in shot.taken).taken[name] = taken
            except DeviceError as error:
                self._bring_back(name, error)
                return []
            if isinstance(feed, StreamFeed) and feed.unanswered:
                self._unanswered(name, feed.unanswered)
                feed.unanswered = 0
        finished = []
        while self._open and len(self._open[0].taken) == len(self._feeds):
            shot = self._open.popleft()
            if shot.is_whole:
                finished.append(shot)
            else:
                self._timing.miss()
        return finished

    @property
    def are_streams(self) -> bool:
        """True if all cameras deliver frames that nobody asked for."""
        return all(feed.is_stream for feed in self._feeds.values())

    @property
    def lost(self) -> int:
        """Number of frames that the open streams have lost so far."""
        return sum(feed.lost for feed in self._feeds.values())

    def give_up(self) -> None:
        """Count the images that have not come at the end as missing, and tell of triggers that failed."""
        for name, feed in self._feeds.items():
            waits = sum(name not in shot.taken for shot in self._open)
            if isinstance(feed, StreamFeed) and feed.is_triggered and waits:
                self._unanswered(name, waits)
        self.drop()

    def require_triggers(self) -> None:
        """With `every_frame`, count an image as missing if a triggered camera has not taken any."""
        if self._every_frame and self._leader[1].is_triggered and not self._timing.asked:
            self._miss_triggers(1)

    def _miss_triggers(self, count: int) -> None:
        """Count images that a triggered camera that leads should have taken."""
        if count:
            self._timing.lose(count)
            self._unanswered(self._leading, count)

    def _unanswered(self, camera: str, count: int) -> None:
        """Tell that a triggered camera took no frames at its triggers; the first time at once."""
        self._silent[camera] = count + self._silent.get(camera, 0)
        # the rig's pulses follow the frames of a camera that leads
        given_by = [] if camera == self._leading else self._run.pulses.lines("exposure")
        told = sentence(camera, self._silent[camera], given_by)
        if camera not in self._timing.causes:
            self._run.log("warning", told)
        self._timing.causes[camera] = told

    def drop(self) -> None:
        """Count the images that are still asked for as missing."""
        for _ in self._open:
            self._timing.miss()
        self._open.clear()

    def close(self) -> None:
        """End the streams, wait for it, and tell of frames that were lost."""
        feeds, self._feeds = self._feeds, {}
        for name, feed in feeds.items():
            try:
                if (call := feed.begin_close()) is not None:
                    self._run.finish(call)
            except DeviceError as error:
                self._run.log("warning", str(error))
            if lost := feed.losses():
                self._run.log("warning", lost)
            if name == self._leading and isinstance(feed, StreamFeed):
                # not of the others, which miss an image where they have lost a frame
                self._timing.lose(feed.lost_since)
        self._images.begin_numbers_anew()

    def leave(self) -> None:
        """Begin to end the streams without waiting, because the machines must be stopped first."""
        for feed in self._feeds.values():
            with suppress(DeviceError):
                feed.begin_close()

    def _bring_back(self, name: str, error: DeviceError) -> None:
        """Open a camera that has failed again, and begin anew with all cameras."""
        run, now_s = self._run, self._run.clock.now_s()
        self._returns_s.append(now_s)
        too_often = len(self._returns_s) > RETURNS_MAX and now_s - self._returns_s[0] < _RETURNS_S
        hangs = f"cameras.{name}" in run.calls.lost
        if self._images.cameras[name].reopen is None or too_often or hangs:
            raise error
        self.drop()
        self.close()
        self._images.bring_back(CameraLost(name, error), "an acquisition")
        last_s = self._last_s
        self.open()
        if not math.isnan(last_s):
            self._timing.lose(self._frames_since(last_s))

    def _frames_since(self, time_s: float) -> int:
        """Return how many frames the leading camera would have given since a time; of a triggered one, 1."""
        _, leader = self._leader
        missing = 0 if leader.is_triggered else (self._ready_s - time_s) / leader.shortest_s
        return max(1, math.floor(missing)) if missing < math.inf else 1
