"""The engine executes the steps of a protocol and makes the rig safe at the end of every run."""

from collections import deque
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import replace

from dic.runfile.schema import RunStatus
from drivers.errors import DeviceError
from drivers.interfaces import Frame, OperatorQuestion
from rig.devices import Rig
from rig.engine.acquisition import AcquisitionRun
from rig.engine.announcements import Announcements
from rig.engine.context import RunContext
from rig.engine.devices import OnQuestion, unannounced
from rig.engine.filing import record_step
from rig.engine.imaging import Frames, StepImages
from rig.engine.listeners import LEAVING_S
from rig.engine.look import look
from rig.engine.measuring import begin_channels, end_channels, follow_channels
from rig.engine.motion import RunMotion
from rig.engine.preparation import Preparation
from rig.engine.questions import Questions
from rig.engine.safety import SafeState
from rig.engine.settings import SettingsRecord
from rig.engine.status import EngineStatus, MeasuredAtRest, News, Outcome, State
from rig.engine.timing import Timing
from rig.errors import Aborted, RigError
from rig.live.values import LiveMeasurement
from rig.protocol.protocol import Protocol
from rig.protocol.step import ProtocolStep, RigReading
from rig.recorder import Recorder, StepRecord
from rig.recorder.records import COMPLETED, STEP_REACHED

KEPT_RECORDS = 1000
"""Number of the newest steps of an acquisition that the outcome of a run has."""


class Engine:
    """Runs one protocol once.

    ::

        IDLE --run--> PREPARING --> MOVING --> IMAGING --> COMPLETED
                          ^            ^          |
                          |            +---step---+
                          +--grid, reference------+

        PREPARING, MOVING, IMAGING --pause--> PAUSED --go on--> the state before

        any of these --abort, exception--> SAFING --> ABORTED | FAILED

    In the state PREPARING, the engine brings the stage to 0 degrees, asks the operator to attach or remove
    the grid, zeroes the load frame, or asks a question of the protocol. The state MOVING lasts until load,
    displacement or angle has settled. The state IMAGING ends when the step is in the run file. In the state
    SAFING, the engine first holds the load frame and stops the stage, and then closes the run file.

    Parameters
    ----------
    protocol : Protocol
    rig : Rig
        The opened devices. The caller closes the devices after the run.
    recorder : Recorder
        The open run file. The engine closes the run file at the end of the run.
    on_status : iterable of callable, optional
        Listeners that are called with an `EngineStatus` at every reading, every change of state and every
        finished step. The state SAFING is reported after the engine has sent the stop commands. The states
        COMPLETED, ABORTED and FAILED are reported after the run file is closed.
    on_step : iterable of callable, optional
        Listeners that are called with a `StepRecord` when a step has been written to the run file.
    on_news : iterable of callable, optional
        Listeners that are called with every `EngineStatus`, `StepRecord` and `LogEntry`, in their order.
    earlier : mapping of int to RigReading, optional
        Settled readings of steps that an earlier run has finished. These steps are not executed again.
    on_progress : callable, optional
        Function that is called after each complete, valid reading of all devices, with True if a device may
        be moving. The engine's own thread calls the function, so the calls stop if the engine hangs. The
        function must return at once. If the function raises an exception, the run ends.
    on_question : callable, optional
        Called with an `OperatorAction` and a sentence of the operator's driver (or an empty text) before the
        operator is asked, on the thread that asks. The returned context manager is left after the answer.

    Attributes
    ----------
    context : RunContext
        What the parts of the engine share.
    leaving_s : float
        Real time in s for all listeners together to handle the reports that still wait at the end of the run.

    Notes
    -----
    The thread of `run` calls no driver and writes no output. So neither a driver nor a terminal that hangs
    can stop the monitoring of load frame and stage. Each device is called on a thread of its own with a
    deadline (`rig.engine.calls`).

    Each listener is called on a thread of its own. If a listener is too slow, it misses some calls, and the
    outcome says so. If a listener raises an exception, the engine does not call that listener again. The run
    and the other listeners continue, and the run file and the outcome record the failure. To end the run, a
    listener calls `abort`.
    """

    def __init__(
        self,
        protocol: Protocol,
        rig: Rig,
        recorder: Recorder,
        *,
        on_status: Iterable[Callable[[EngineStatus], None]] = (),
        on_step: Iterable[Callable[[StepRecord], None]] = (),
        on_news: Iterable[Callable[[News], None]] = (),
        on_progress: Callable[[bool], None] = lambda _: None,
        on_question: OnQuestion = unannounced,
        earlier: Mapping[int, RigReading] | None = None,
    ) -> None:
        self.leaving_s = LEAVING_S
        self._earlier = dict(earlier or {})
        self._goes_on = bool(earlier)
        self._next_index = 0
        self._records: list[StepRecord] = []
        # An acquisition may have a million images, whose records are in the run file.
        self._acquired: deque[StepRecord] = deque(maxlen=KEPT_RECORDS)
        planned, before = len(protocol.steps()), len(self._earlier)
        status = EngineStatus(
            State.IDLE, None, planned, 0, None, rig.simulated, before, load_is_measured=bool(rig.measured)
        )
        self._news = Announcements(recorder, rig.clock, status, on_status, on_step, on_news, self.abort)
        self.context = RunContext(protocol, rig, recorder, self._news, on_progress, on_question)
        self._motion = RunMotion(self.context)
        self._preparation = Preparation(self.context, self._motion)
        self._images = StepImages(self.context, self._motion)
        self._acquisition = AcquisitionRun(self.context, self._images, self._motion, self._file)
        self._questions = Questions(self.context, self._motion)
        self._settings = SettingsRecord(self.context)
        self._safe_state = SafeState(rig)

    def measure_gauges_with(self, live: LiveMeasurement) -> None:
        """Give what measures the live gauges of the protocol. The engine closes it at the end of the run."""
        self.context.live.measurement = live

    @property
    def status(self) -> EngineStatus:
        """The latest snapshot of the run. Any thread may read this property."""
        return self._news.status

    @property
    def newest_images(self) -> dict[str, Frame]:
        """The newest good image of each camera. Any thread may read this property."""
        return dict(self._images.newest)

    @property
    def waiting_for_operator(self) -> bool:
        """True while the run waits for an answer from the operator."""
        return self._preparation.asking or self.question is not None

    @property
    def question(self) -> OperatorQuestion | None:
        """The question of the protocol that waits for its answer, or None."""
        return self._questions.open

    @property
    def pause_requested(self) -> bool:
        """True from the request of a pause until the run goes on."""
        return self.context.pauses.switch.on

    def run(self) -> Outcome:
        """Execute the protocol and close the run file with the outcome.

        Returns
        -------
        Outcome
            The result of the run. A run that ends by an abort, a `RigError` or a `DeviceError` also returns
            an outcome. The engine raises any other exception again after it has made the rig safe and closed
            the run file. If devices did not confirm their safe state, a note on this exception names them.
        """
        # Announce this thread first, so that no simulated time passes before this thread takes a reading.
        with self.context.clock.activity():
            try:
                self._preparation.require_devices()
                self._questions.require_operator()
                begin_channels(self.context)
                self._settings.at_start()
                self.context.protocol.follow(self._execute)
                self._end_well()
            except BaseException as error:
                outcome = self._end_badly(error)
                if not isinstance(error, (RigError, DeviceError)):
                    if outcome.unsafe:
                        error.add_note(outcome.reason)
                    raise
                return outcome
            return self._outcome("completed", "")

    def abort(self, reason: str) -> None:
        """Request the end of the run without waiting. Any thread may call this method, also repeatedly.

        The method commands the safe state at once: the load frame holds and the stage stops. `abort` also
        ends every wait of the engine, and the engine then commands the safe state again. A signal handler
        must not call this method, because the handler may have interrupted a thread that holds a lock.
        """
        if self.status.state in (State.COMPLETED, State.ABORTED, State.FAILED):
            return
        if self.context.abort_reason is None:
            self.context.abort_reason = reason
        self._safe_state.command()
        self.context.calls.interrupt()

    def request_image(self) -> str:
        """Ask for an image now, in a protocol that takes images on request. Any thread may call this.

        Return why the request is refused, or an empty text.
        """
        return self._acquisition.request_image()

    def request_end(self) -> str:
        """End the images of an acquisition now. Any thread may call this.

        Return why the request is refused, or an empty text.
        """
        return self._acquisition.request_end()

    def pause(self, who: str, *, at_machine: bool = False) -> str:
        """Request a pause without waiting. Any thread may call this method, also repeatedly.

        The load frame holds and the stage stops at once, as for an abort, and the engine holds them again
        when it sees the request. Images that are being taken are finished. `who` is recorded. Return why the
        request is refused, or an empty text. A pause by a person `at_machine` ends only by such a person. An
        abort ends every pause.
        """
        state = self.status.state
        if state is State.IDLE or state.ending or self.context.abort_reason is not None:
            return f"a run can be paused from its beginning until it ends; it is {state.value}"
        self.context.pauses.switch.pause(who, at_machine=at_machine)
        self._safe_state.command()
        self.context.calls.interrupt()
        return ""

    def go_on(self, who: str, *, at_machine: bool = False) -> str:
        """Let a paused run go on. Any thread may call this method.

        Return why the request is refused, or an empty text.
        """
        return self.context.pauses.switch.go_on(who, at_machine=at_machine)

    def answer(self, word: str, who: str) -> str:
        """Answer the question of the protocol that waits for the operator. Any thread may call this method.

        Return why the answer is refused, or an empty text.
        """
        return self._questions.answer(word, who)

    def _execute(self, step: ProtocolStep) -> RigReading:
        if step.index < self._next_index:
            # An acquisition takes as many images as its test needs, and not as many as were planned.
            step = replace(step, index=self._next_index)
        if step.acquisition is not None:
            self._enter(State.IMAGING, step)
            reading = self._acquisition.take(step)
            self._next_index = self._acquisition.next_index
            return reading
        if self._acquisition.next_index:
            self._next_index = step.index + 1
        if step.passed:
            return self._leave_out(step)
        if step.index in self._earlier:
            return self._earlier[step.index]
        if self._goes_on or step.kind in ("grid", "reference"):
            self._prepare(step)
        if step.kind == "reference":
            self.context.pulses.give("start")
        if step.question is not None:
            self._enter(State.PREPARING, step)
            return self._questions.ask(step, step.question)
        self._enter(State.MOVING, step)
        frames: Frames | None = None
        for reading in self._motion.moments(step):
            if frames is None:
                self._enter(State.IMAGING, step)
            frames = self._images.take(step, reading, frames or {})
        self.context.live.keep(step.kind, self._images.newest)
        if frames is not None:
            self._finish(StepRecord(step, self._motion.reading, frames))
        elif not step.images:
            self.context.mark(f"{STEP_REACHED} {step.index}")
        return replace(self._motion.reading, ends_phase=self.context.phase_ended)

    def _leave_out(self, step: ProtocolStep) -> RigReading:
        reading = self.context.read()
        self.context.log(
            "warning",
            f"{step} is left out, because its target has been passed: {step.value(reading):.6g} {step.unit}",
        )
        return reading

    def _prepare(self, step: ProtocolStep) -> None:
        self._enter(State.PREPARING, step)
        if self._goes_on:
            self._goes_on = False
            self._preparation.to_go_on()
        elif step.kind == "grid":
            self._preparation.for_grid(step)
        else:
            self._preparation.for_reference(step)

    def _finish(self, record: StepRecord) -> None:
        record_step(self.context, record)
        self._file(record)

    def _file(self, record: StepRecord) -> None:
        """Tell that a step is on the disk."""
        (self._records if record.step.kind != "acquired" else self._acquired).append(record)
        self._news.step(record)
        self.context.pulses.give("step")

    def _enter(self, state: State, step: ProtocolStep | None) -> None:
        self._news.publish(state=state, step=step)

    def _end_well(self) -> None:
        self.context.devices.hold()
        self.context.pulses.give("end")
        self.context.pulses.finish()
        if (last_image_s := self._images.last_exposed_s) is not None:
            follow_channels(self.context, last_image_s)
        self._settings.at_end()
        end_channels(self.context)
        self.context.live.close()
        for sentence in self.context.channels.new_losses(whole=True):
            self.context.log("warning", sentence)
        self.context.log("info", COMPLETED)
        self.context.recorder.close("completed", "", self.context.clock.utc())
        self._enter(State.COMPLETED, self.status.step)

    def _end_badly(self, error: BaseException) -> Outcome:
        run = self.context
        unsafe = self._safe_state.confirm(meanwhile=lambda: self._news.publish(state=State.SAFING))
        status: RunStatus = "failed" if run.abort_reason is None else "aborted"
        reason = str(error) or type(error).__name__
        if run.abort_reason is not None and not isinstance(error, Aborted):
            # Name the abort first, because its stop command may have caused the error of the driver.
            reason = f"{run.aborted()}; meanwhile: {reason}"
        if unsafe:
            reason = f"SAFE STATE NOT CONFIRMED, use the emergency stop ({'; '.join(unsafe)}). {reason}"
        end_channels(run)
        run.live.close()
        # Ignore an error, because the status of the run may be written even if settings and this event
        # cannot.
        with suppress(RigError):
            self._settings.at_end()
        with suppress(RigError):
            for sentence in run.channels.new_losses(whole=True):
                self.context.log("warning", sentence)
            self.context.log("error", reason)
        try:
            run.recorder.close(status, reason, run.clock.utc())
        except RigError as closing:
            reason = f"{reason}; and then {closing}"
        self._enter(State.ABORTED if status == "aborted" else State.FAILED, self.status.step)
        return self._outcome(status, reason, tuple(unsafe))

    def _outcome(self, status: RunStatus, reason: str, unsafe: tuple[str, ...] = ()) -> Outcome:
        run = self.context
        at_end = look(run.devices, run.calls, self._safe_state.confirmed)
        if run.rig.measured and (reading := self.status.reading) is not None:
            measured = MeasuredAtRest(reading.load_n, reading.displacement_mm)
            at_end = replace(at_end, measured=measured)
        run.calls.close()
        self._news.close(self.leaving_s)
        return Outcome(
            status,
            reason,
            self.status.steps_done,
            unsafe,
            tuple(self._news.lost),
            run.rig.lost_devices,
            tuple(sorted([*self._records, *self._acquired], key=lambda record: record.step.index)),
            run.recorder.failure is None,
            at_end,
            Timing.together(self._acquisition.timings),
            run.pauses.totals,
            {name: lost for name, (_, lost) in run.channels.counts.items() if lost},
        )
