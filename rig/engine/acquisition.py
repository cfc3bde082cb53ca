"""Take the images of an acquisition at their times, while the channels are recorded densely beside them."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from drivers.errors import DeviceFault
from rig.engine.context import RunContext
from rig.engine.drive import Drive, drive_of
from rig.engine.filing import record_frame
from rig.engine.imaging import Frames, StepImages
from rig.engine.motion import RunMotion
from rig.engine.seldom import SeldomWarnings
from rig.engine.shots import Shot, Shots
from rig.engine.timing import Timing
from rig.engine.written import WrittenSteps
from rig.errors import BadImage
from rig.protocol.acquire import Acquisition
from rig.protocol.acquisition_tables import FirstBeyond
from rig.protocol.dues import AskedDues, Dues
from rig.protocol.pull_stages import PullPlan
from rig.protocol.step import ProtocolStep, RigReading
from rig.recorder import StepRecord

_LAST_IMAGES_S = 2.0
"""After the end, images that are due already are waited for at most for this time in s, added to the timeout
of an image."""
_GAUGES_S = 10.0
"""Before a motion, valid strains of live gauges are waited for, added to the timeout of an image."""
_SHOW_EVERY_S = 0.25
_LAST_FRAMES_S = 1.0
"""After the end, a frame that was exposed before it is waited for at most for this time in s."""
_PAUSE_LEAST_S = 1e-3
_PLACE = "between two images"
"""Where a run may be paused, for the record."""


class AcquisitionRun:
    """Takes all images of acquisitions during one run.

    `filed` is called with each step that is on the disk. Any thread may call `request_image` and
    `request_end`.
    """

    def __init__(
        self,
        run: RunContext,
        images: StepImages,
        motion: RunMotion,
        filed: Callable[[StepRecord], None],
    ) -> None:
        self._run, self._images, self._motion = run, images, motion
        self._drive = Drive()
        self._written = WrittenSteps(run, filed)
        self._warnings = SeldomWarnings(run.clock, lambda sentence: run.log("warning", sentence))
        self._asked: AskedDues | None = None
        self._shown_s = -math.inf
        self._runs = self._end_requested = False
        self.timing = Timing()
        self.timings: list[Timing] = []
        self.next_index = 0

    def request_image(self) -> str:
        """Ask for an image now. Return why the request is refused, or an empty text."""
        if not self._runs:
            return "no images are being taken now"
        if (asked := self._asked) is None:
            return "this protocol does not take images on request"
        if self._run.pauses.switch.on:
            return "the run is paused"
        asked.ask(self._run.clock.now_s())
        return ""

    def request_end(self) -> str:
        """End the images; the run goes on with what follows them. Return why the request is refused."""
        if not self._runs:
            return "no images are being taken now"
        self._end_requested = True
        return ""

    def take(self, step: ProtocolStep) -> RigReading:
        """Take all images of the acquisition that begins with `step`, and return the last reading."""
        acquisition, run = step.acquisition, self._run
        assert isinstance(acquisition, Acquisition)
        self.timing = Timing(acquisition.interval_s, acquisition.schedule.lateness_max_s, acquisition.planned)
        self.timings.append(self.timing)
        every_frame = acquisition.schedule.every_frame is not None
        shots = Shots(run, self._images, self.timing, every_frame=every_frame)
        dues = acquisition.dues()
        self._drive = drive_of(run, step, acquisition.pull, self._motion.stand_still)
        run.live.prepare(run.calls)
        self._asked = dues if isinstance(dues, AskedDues) else None
        self._end_requested, self._runs = False, True
        try:
            shots.open()
            begun_s = self._wait_for_beginning(acquisition, shots)
            if acquisition.first_is_reference:
                run.pulses.give("start")
            self._drive.begin()
            reading = self._follow(step, dues, shots, begun_s)
            self._runs = False
            self._finish(step, shots, min(reading.time_s, begun_s + acquisition.duration_s))
            shots.require_triggers()
        except BaseException:
            shots.leave()
            raise
        finally:
            self._runs, run.observers = False, []
            run.news.publish(live=None)
        shots.close()
        self._written.finish()
        self._warnings.finish()
        self._publish()
        for sentence in self.timing.sentences():
            run.log("warning" if self.timing.is_late else "info", sentence)
        return reading

    def _wait_for_beginning(self, acquisition: Acquisition, shots: Shots) -> float:
        run, begin = self._run, acquisition.schedule.begin
        self._wait_for_streams(shots)
        if acquisition.pull is not None and acquisition.pull.gauges | run.live.limited:
            self._wait_for_gauges(acquisition.pull, shots)
        if begin is None:
            return run.clock.now_s()
        run.log("info", f"waiting for {begin}")
        self._publish(waits_for=str(begin))
        first = FirstBeyond(begin)
        run.observers = [first.see]
        while math.isnan(first.time_s):
            run.read()
            if self._end_requested:
                return run.clock.now_s()
            if run.pauses.asked(_PLACE):
                self._pause(shots)
            shots.poll()
            run.calls.pause(run.settle.poll_s)
        run.log("info", f"{begin} was reached")
        return first.time_s

    def _wait_for_streams(self, shots: Shots) -> None:
        while not shots.are_ready:
            self._run.read()
            shots.poll()
            self._run.calls.pause(self._run.settle.poll_s)

    def _wait_for_gauges(self, pull: PullPlan, shots: Shots) -> None:
        """Wait until the gauges that a motion needs have valid strains."""
        run = self._run
        gauges = pull.gauges | run.live.limited
        if not shots.are_streams:
            raise DeviceFault(
                "cameras",
                pull.where,
                "cameras that stream, for strains that a motion needs",
                "a camera that only takes images when it is asked",
                "use a driver with streams, or stages without strain",
            )
        waited_s = run.protocol.images.timeout_s + _GAUGES_S
        end_s = run.clock.now_s() + waited_s
        while any(map(run.live.not_valid, gauges)) and run.clock.now_s() < end_s:
            run.read()
            shots.poll()
            run.calls.pause(run.settle.poll_s)
        run.live.require_valid(gauges, pull.where, waited_s)

    def _pause(self, shots: Shots) -> None:
        """Take no images while the run is paused. A machine that takes no commands goes on."""
        run = self._run
        begun_s = run.clock.now_s()
        shots.close()
        run.pauses.point(_PLACE)
        shots.open()
        self._wait_for_streams(shots)
        self._drive.again(run.clock.now_s() - begun_s)

    def _follow(self, step: ProtocolStep, dues: Dues, shots: Shots, begun_s: float) -> RigReading:
        run, acquisition = self._run, step.acquisition
        assert isinstance(acquisition, Acquisition)
        ends = acquisition.end_of_signals()
        dues.begin(begun_s)
        shots.begin(begun_s)
        run.observers = [dues.see, ends.see]
        due_s: float | None = None
        self._publish()
        while True:
            reading = run.read()
            ended = self._drive.see(reading) or self._ended(acquisition, ends.met, shots, begun_s)
            if not ended and run.pauses.asked(_PLACE):
                self._finish(step, shots, reading.time_s)
                self._pause(shots)
            if acquisition.schedule.every_frame:
                shots.take_frames(reading, acquisition.images, begun_s + acquisition.duration_s)
            while self.timing.asked < acquisition.images and not self._end_requested:
                due_s = dues.next_s() if due_s is None else due_s
                if due_s is None or due_s > run.clock.now_s():
                    break
                if due_s > run.pauses.ended_s:
                    shots.ask(due_s, reading)
                else:
                    self.timing.paused += 1
                due_s = None
            self._record(step, shots.poll())
            self._show(shots)
            if ended or (due_s == math.inf and not shots.waits):
                self._drive.end()
                run.log("info", f"images end: {ended or 'all are taken'}")
                return reading
            left_s = math.inf if due_s is None else due_s - run.clock.now_s()
            poll_s = min(run.settle.poll_s, self._drive.poll_s)
            run.calls.pause(min(poll_s, max(left_s, _PAUSE_LEAST_S)))

    def _ended(self, acquisition: Acquisition, of_signals: str, shots: Shots, begun_s: float) -> str:
        if self._end_requested:
            return "the operator has ended them"
        if of_signals:
            return of_signals
        if self.timing.asked >= acquisition.images and not shots.waits:
            return f"{acquisition.images} images were asked for"
        # the image at the very end is still due
        late_s = self._run.clock.now_s() - begun_s - acquisition.duration_s
        return f"{acquisition.duration_s:g} s are over" if late_s > 0.0 and not shots.waits else ""

    def _finish(self, step: ProtocolStep, shots: Shots, until_s: float) -> None:
        """Wait for the images that were asked for before the end, and for the frames exposed until then."""
        run, acquisition = self._run, step.acquisition
        assert isinstance(acquisition, Acquisition)
        now_s = run.clock.now_s()
        end_s, frames_s = now_s + run.protocol.images.timeout_s + _LAST_IMAGES_S, now_s + _LAST_FRAMES_S
        more = acquisition.schedule.every_frame is not None
        while (shots.waits or more) and run.clock.now_s() < end_s:
            reading = run.read()
            more = more and not shots.take_frames(reading, acquisition.images, until_s)
            more = more and run.clock.now_s() < frames_s and self.timing.asked < acquisition.images
            self._record(step, shots.poll())
            run.calls.pause(run.settle.poll_s)
        shots.give_up()

    def _record(self, first: ProtocolStep, shots: list[Shot]) -> None:
        missing = self.timing.missing
        for shot in shots:
            self._record_one(first, shot)
        self._written.check()
        if shots or missing != self.timing.missing:
            self._publish()

    def _record_one(self, first: ProtocolStep, shot: Shot) -> None:
        acquisition = first.acquisition
        assert isinstance(acquisition, Acquisition)
        middle_s = float(np.mean([frame.middle[0] for frame in shot.frames.values()]))
        number = self.timing.take(shot.due_s, middle_s)
        step = acquisition.step(first.index, number, middle_s - self.timing.first_s)
        # As in a hold, the numbers of images that fell into pauses are left out: these are not missing.
        step = replace(step, index=step.index + self.timing.paused)
        self.next_index = step.index + 1
        try:
            findings = self._images.judge(step, shot.frames)
        except BadImage:
            # The run ends, but nothing else shows this moment.
            self._record_frames(shot, None)
            raise
        for device, sentence in findings.items():
            self._warnings.warn(device, f"{device}: {step}: {sentence}")
        # The reference stays, because every later image is compared with it.
        frames = self._record_frames(shot, None if step.kind == "reference" else acquisition.schedule.keep_s)
        # Drop the samples, which are in the tables of the channels, so that many steps need little memory.
        reading = replace(shot.reading, time_s=middle_s, signals={})
        self._written.add(StepRecord(step, reading, frames, shot.due_s))

    def _record_frames(self, shot: Shot, keep_s: float | None) -> Frames:
        self._images.newest |= shot.frames
        return {
            name: (record_frame(self._run, name, frame, keep_s), 1) for name, frame in shot.frames.items()
        }

    def _publish(self, waits_for: str = "") -> None:
        now = self.timing.now(waits_for, on_request=self._asked is not None)
        self._run.news.publish(acquisition=now)

    def _show(self, shots: Shots) -> None:
        """Publish what people see of the live gauges, a few times in a second."""
        run, timing = self._run, self.timing
        if not run.live.is_measuring or run.clock.now_s() - self._shown_s < _SHOW_EVERY_S:
            return
        self._shown_s = run.clock.now_s()
        interval_s = timing.now("", on_request=False).reached_s
        run.news.publish(live=run.live.now(timing.taken, 1.0 / interval_s, shots.lost))
