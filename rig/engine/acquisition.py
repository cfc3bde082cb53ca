"""Take the images of an acquisition at their times, while the channels are recorded densely beside them."""

import math
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np

from drivers.errors import DeviceError
from drivers.interfaces import Frame
from rig.engine.context import RunContext
from rig.engine.devices import CameraLost
from rig.engine.feeds import Feed, feed_of
from rig.engine.filing import ON_FILE, record_frame
from rig.engine.imaging import StepImages
from rig.engine.timing import Timing
from rig.errors import RecordingError
from rig.protocol.acquire import Acquisition
from rig.protocol.dues import AskedDues
from rig.protocol.step import ProtocolStep, RigReading
from rig.recorder import StepRecord

_LAST_IMAGES_S = 2.0
"""After the end, images that are due already are waited for at most for this time in s."""


@dataclass
class _Moment:
    """One time at which all cameras take an image. `reading` is the one after which it was asked for."""

    number: int
    due_s: float
    reading: RigReading
    frames: dict[str, Frame] = field(default_factory=dict)


class AcquisitionRun:
    """Takes all images of acquisitions during one run.

    `filed` is called with each step that is on the disk. Any thread may call `request_image` and
    `request_end`.
    """

    def __init__(self, run: RunContext, images: StepImages, filed: Callable[[StepRecord], None]) -> None:
        self._run, self._images, self._filed = run, images, filed
        self._feeds: dict[str, Feed] = {}
        self._open: deque[_Moment] = deque()
        self._writing: deque[tuple[StepRecord, Future[None], float]] = deque()
        self._asked: AskedDues | None = None
        self._end_requested = False
        self.timing = Timing()
        self.next_index = 0

    def request_image(self) -> None:
        """Ask for an image now, if the protocol takes images on request."""
        if (asked := self._asked) is not None:
            asked.ask(self._run.clock.now_s())

    def request_end(self) -> None:
        """End the images; the run goes on with what follows them."""
        self._end_requested = True

    def take(self, step: ProtocolStep) -> RigReading:
        """Take all images of the acquisition that begins with `step`, and return the last reading."""
        acquisition, run = step.acquisition, self._run
        assert isinstance(acquisition, Acquisition)
        self.timing = Timing(acquisition.interval_s, acquisition.schedule.lateness_max_s)
        self._end_requested = False
        try:
            for name in self._images.cameras:
                self._open_feed(name)
            begun_s = self._wait_for_beginning(acquisition)
            if acquisition.first_is_reference:
                self._run.pulses.give("start")
            reading = self._follow(step, acquisition, begun_s)
            self._finish_open(step)
        finally:
            for feed in self._feeds.values():
                with suppress(DeviceError):
                    feed.close()
        self._require_written(whole=True)
        for sentence in self.timing.sentences():
            run.log("warning" if self.timing.is_late else "info", sentence)
        return reading

    def _wait_for_beginning(self, acquisition: Acquisition) -> float:
        run, begin = self._run, acquisition.schedule.begin
        if begin is None:
            return run.clock.now_s()
        run.log("info", f"waiting for {begin}")
        while not begin.is_met(reading := run.read()):
            if self._end_requested:
                return run.clock.now_s()
            self._poll()
            run.calls.pause(run.settle.poll_s)
        run.log("info", f"{begin} was reached")
        found = reading.signals[begin.signal]
        beyond = [begin.is_beyond(value) for value in found.values.tolist()]
        return float(found.time_s[beyond.index(True)])

    def _follow(self, step: ProtocolStep, acquisition: Acquisition, begun_s: float) -> RigReading:
        run, dues, ends = self._run, acquisition.dues(), acquisition.end_of_signals()
        self._asked = dues if isinstance(dues, AskedDues) else None
        dues.begin(begun_s)
        due_s: float | None = None
        while True:
            reading = run.read()
            ended = self._ended(acquisition, ends.met(reading), begun_s)
            while True:
                due_s = dues.next_s(reading) if due_s is None else due_s
                if due_s is None or due_s > run.clock.now_s() or self.timing.asked >= acquisition.images:
                    break
                self._ask(due_s, reading)
                due_s = None
            self._poll()
            self._finish_moments(step)
            if ended or (due_s == math.inf and not self._open):
                run.log("info", f"images end: {ended or 'all are taken'}")
                return reading
            left_s = math.inf if due_s is None else due_s - run.clock.now_s()
            run.calls.pause(min(run.settle.poll_s, max(left_s, 1e-3)))

    def _ended(self, acquisition: Acquisition, of_signals: str, begun_s: float) -> str:
        if self._end_requested:
            return "the operator has ended them"
        if of_signals:
            return of_signals
        if self.timing.asked >= acquisition.images and not self._open:
            return f"{acquisition.images} images are taken"
        # the image at the very end is still due
        late_s = self._run.clock.now_s() - begun_s - acquisition.duration_s
        return f"{acquisition.duration_s:g} s are over" if late_s > 0.0 and not self._open else ""

    def _ask(self, due_s: float, reading: RigReading) -> None:
        """Ask all cameras for an image, or count it as missing if they are too slow."""
        number = self.timing.ask()
        if len(self._open) >= min(feed.most_open for feed in self._feeds.values()):
            self.timing.miss()
            return
        self._run.pulses.give("exposure")
        self._open.append(_Moment(number, due_s, reading))
        for feed in self._feeds.values():
            feed.ask(due_s)

    def _poll(self) -> None:
        """Take what the cameras have delivered. A camera that fails is opened again."""
        for name, feed in list(self._feeds.items()):
            try:
                frame = feed.take()
            except DeviceError as error:
                self._bring_back(name, error)
                continue
            if frame is not None:
                moment = next(each for each in self._open if name not in each.frames)
                moment.frames[name] = frame

    def _bring_back(self, name: str, error: DeviceError) -> None:
        with suppress(DeviceError):
            self._feeds.pop(name).close()
        for _ in range(len(self._open)):
            self.timing.miss()
        self._open.clear()
        for other in list(self._feeds):
            # The images that were asked for are not taken any more, so begin anew with all cameras.
            with suppress(DeviceError):
                self._feeds.pop(other).close()
        self._images.bring_back(CameraLost(name, error), "an acquisition")
        for camera in self._images.cameras:
            self._open_feed(camera)

    def _open_feed(self, name: str) -> None:
        timeout_s = self._run.protocol.images.timeout_s
        self._feeds[name] = feed_of(self._images.cameras[name], self._run.clock, timeout_s)

    def _finish_open(self, step: ProtocolStep) -> None:
        """Wait for the images that were asked for before the end."""
        run, begun_s = self._run, self._run.clock.now_s()
        while self._open and run.clock.now_s() - begun_s < _LAST_IMAGES_S:
            run.read()
            self._poll()
            self._finish_moments(step)
            run.calls.pause(run.settle.poll_s)
        for _ in range(len(self._open)):
            self.timing.miss()
        self._open.clear()

    def _finish_moments(self, step: ProtocolStep) -> None:
        while self._open and len(self._open[0].frames) == len(self._feeds):
            self._record(step, self._open.popleft())
        self._require_written()

    def _record(self, first: ProtocolStep, moment: _Moment) -> None:
        run, acquisition = self._run, first.acquisition
        assert isinstance(acquisition, Acquisition)
        middle_s = float(np.mean([frame.middle[0] for frame in moment.frames.values()]))
        number = self.timing.take(moment.due_s, middle_s)
        step = acquisition.step(first.index, number, middle_s - self.timing.first_s)
        self.next_index = step.index + 1
        self._images.judge(step, moment.frames)
        frames = {}
        for name, frame in moment.frames.items():
            frames[name] = record_frame(run, name, frame), 1
            self._images.newest[name] = frame
        record = StepRecord(step, replace(moment.reading, time_s=middle_s), frames, moment.due_s)
        self._writing.append((record, run.recorder.step(record), run.clock.now_s()))
        run.pulses.give("step")

    def _require_written(self, *, whole: bool = False) -> None:
        """Tell of the steps that are on the disk. Raise `RecordingError` if the disk is too slow.

        With `whole`, wait until all are.
        """
        run = self._run
        while self._writing:
            record, written, since_s = self._writing[0]
            if whole:
                run.finish(run.calls.follow(written, "run file", f"write {record.step}", ON_FILE))
            if not written.done():
                if run.clock.now_s() - since_s > ON_FILE.duration_s:
                    raise RecordingError(
                        str(run.recorder.path),
                        f"{record.step} on the disk within {ON_FILE.duration_s:g} s",
                        "none",
                        ON_FILE.remedy,
                    )
                return
            written.result()
            self._writing.popleft()
            self._filed(record)
