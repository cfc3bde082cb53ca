"""The engine executes the steps of a protocol and makes the rig safe at the end of every run."""

from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import replace

from dic.runfile.schema import Level, RunStatus
from drivers.clock import SystemClock
from drivers.errors import DeviceError
from drivers.interfaces import Frame, OperatorAction
from rig.devices import Rig
from rig.engine.calls import Calls
from rig.engine.devices import OnQuestion, called, unannounced
from rig.engine.filing import Filing
from rig.engine.imaging import StepImages, Surroundings
from rig.engine.listeners import LEAVING_S, Listeners
from rig.engine.look import look, unloaded
from rig.engine.monitor import Monitor
from rig.engine.motion import Around, Motion
from rig.engine.preparation import Actions, Preparation
from rig.engine.requirements import require_devices
from rig.engine.safety import SafeState
from rig.engine.settings import SettingsRecord
from rig.engine.status import LogEntry, News, Outcome, State, Status
from rig.engine.watch import Watch
from rig.errors import Aborted, RigError
from rig.limits.run_limits import limits_on
from rig.protocol.protocol import Protocol
from rig.protocol.step import ProtocolStep, Reading
from rig.recorder import Recorder, StepRecord
from rig.recorder.records import OPERATOR_DONE, PHASE_ENDED, STEP_ON_FILE, STEP_REACHED


class Engine:
    """Runs one protocol once.

    ::

        IDLE --run--> PREPARING --> MOVING --> IMAGING --> COMPLETED
                          ^            ^          |
                          |            +---step---+
                          +--grid, reference------+

        any of these --abort, exception--> SAFING --> ABORTED | FAILED

    In the state PREPARING, the engine brings the stage to 0 degrees, asks the operator to attach or remove
    the grid, and zeroes the load frame. The state MOVING lasts until load, displacement or angle has settled.
    The state IMAGING ends when the step is in the run file. In the state SAFING, the engine first holds the
    load frame and stops the stage, and then closes the run file.

    Parameters
    ----------
    protocol : Protocol
    rig : Rig
        The opened devices. The caller closes the devices after the run.
    recorder : Recorder
        The open run file. The engine closes the run file at the end of the run.
    on_status : iterable of callable, optional
        Listeners that are called with a `Status` at every reading, every change of state and every finished
        step. The state SAFING is reported after the engine has sent the stop commands. The states COMPLETED,
        ABORTED and FAILED are reported after the run file is closed.
    on_step : iterable of callable, optional
        Listeners that are called with a `StepRecord` when a step has been written to the run file.
    on_news : iterable of callable, optional
        Listeners that are called with every `Status`, `StepRecord` and `LogEntry`, in the order of the run.
    earlier : mapping of int to Reading, optional
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
        on_status: Iterable[Callable[[Status], None]] = (),
        on_step: Iterable[Callable[[StepRecord], None]] = (),
        on_news: Iterable[Callable[[News], None]] = (),
        on_progress: Callable[[bool], None] = lambda _: None,
        on_question: OnQuestion = unannounced,
        earlier: Mapping[int, Reading] | None = None,
    ) -> None:
        self._watch = Watch(protocol, limits_on(protocol, rig))
        self._protocol = protocol
        self._rig = rig
        self._recorder = recorder
        self._calls = Calls(rig.clock, self._check_abort, rig.lost)
        self._devices = called(rig, self._calls, self._read, protocol.settle.poll_s, on_question)
        self._filing = Filing(recorder, self._calls, self._read, protocol.settle.poll_s)
        self._monitor = Monitor(self._devices, self._calls, rig.clock, recorder, self._watch)
        waits = Around(self._read, self._calls.pause, self._check_abort, lambda: str(self._status.step))
        motion = Motion(protocol.settle, self._devices, self._watch, rig.clock, waits)
        self._motion = motion
        self._preparation = Preparation(
            protocol.conditions,
            self._devices,
            self._monitor,
            self._watch,
            Actions(
                self._read, motion.wait, self._ask, lambda text: self._event("info", text), motion.note_motion
            ),
            unloaded(protocol.conditions, rig),
        )
        around = Surroundings(self._read, motion.settle_again, self._calls.pause, self._event)
        self._images = StepImages(self._devices.cameras, protocol.images, rig.clock, self._filing, around)
        self._settings = SettingsRecord(
            self._devices, lambda: self._images.cameras, self._calls, recorder, rig.clock, self._event
        )
        self._on_status = Listeners(on_status, self.abort)
        self._on_step = Listeners(on_step, self.abort)
        self._on_news = Listeners[News](on_news, self.abort)
        self.leaving_s = LEAVING_S
        self._on_progress = on_progress
        self._earlier = dict(earlier or {})
        self._goes_on = bool(earlier)
        self._records: list[StepRecord] = []
        self._lost_listeners: list[str] = []
        planned, before = len(protocol.steps()), len(self._earlier)
        self._status = Status(State.IDLE, None, planned, 0, None, rig.simulated, before)
        self._abort_reason: str | None = None
        self._waiting_for_operator = False
        self._safe_state = SafeState(rig)

    @property
    def status(self) -> Status:
        """The latest snapshot of the run. Any thread may read this property."""
        return self._status

    @property
    def newest_images(self) -> dict[str, Frame]:
        """The newest good image of each camera. Any thread may read this property."""
        return dict(self._images.newest)

    @property
    def waiting_for_operator(self) -> bool:
        """True while the run waits for an answer from the operator."""
        return self._waiting_for_operator

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
        with self._rig.clock.activity():
            try:
                require_devices(self._protocol, self._rig)
                self._settings.at_start()
                self._protocol.follow(self._execute)
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
        if self._status.state in (State.COMPLETED, State.ABORTED, State.FAILED):
            return
        if self._abort_reason is None:
            self._abort_reason = reason
        self._safe_state.command()
        self._calls.interrupt()

    def _execute(self, step: ProtocolStep) -> Reading:
        if step.passed:
            return self._leave_out(step)
        if step.index in self._earlier:
            return self._earlier[step.index]
        if self._goes_on or step.kind in ("grid", "reference"):
            self._prepare(step)
        self._enter(State.MOVING, step)
        reading = self._motion.reach(step)
        has_arrived = not reading.moving and step.is_reached(reading) and not self._motion.phase_ended
        if not step.images:
            self._filing.mark(self._rig.clock.now_s(), f"{STEP_REACHED} {step.index}")
        elif not (step.timed and not step.holds and has_arrived):
            reading = self._take(step, reading)
        return replace(reading, ends_phase=self._motion.phase_ended)

    def _leave_out(self, step: ProtocolStep) -> Reading:
        reading = self._read()
        self._event(
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

    def _ask(self, action: OperatorAction) -> None:
        self._motion.stand_still()
        self._event("info", f"operator: {action.value}")
        try:
            self._waiting_for_operator = True
            self._check_abort()
            self._devices.operator.perform(action)
            self._filing.mark(self._rig.clock.now_s(), OPERATOR_DONE)
        finally:
            self._waiting_for_operator = False

    def _take(self, step: ProtocolStep, settled: Reading) -> Reading:
        """Take and record the images of all cameras, then record the step."""
        self._enter(State.IMAGING, step)
        frames, settled = self._images.take(step, settled)
        record = StepRecord(step, settled, frames)
        self._filing.step(record)
        self._filing.mark(self._rig.clock.now_s(), STEP_ON_FILE)
        self._records.append(record)
        self._publish(replace(self._status, steps_done=len(self._records)))
        self._note_lost(self._on_step.tell(record) + self._on_news.tell(record))
        return settled

    def _read(self) -> Reading:
        self._check_abort()
        reading = self._monitor.read(str(self._status.step))
        self._publish(replace(self._status, reading=reading))
        if self._motion.see(reading):
            step = self._status.step
            number = "" if step is None else step.index
            self._event("info", f"{PHASE_ENDED} {number}: the load is {reading.load_n:.6g} N")
        self._on_progress(self._motion.may_move or reading.moving)
        self._check_abort()
        return reading

    def _enter(self, state: State, step: ProtocolStep | None) -> None:
        self._publish(replace(self._status, state=state, step=step))

    def _publish(self, status: Status) -> None:
        self._status = status
        self._note_lost(self._on_status.tell(status) + self._on_news.tell(status))

    def _note_lost(self, listeners: list[str]) -> None:
        self._lost_listeners += listeners
        for listener in listeners:
            try:
                self._event("warning", listener)
            except RigError:
                # At the end of a run the run file may be closed or broken, so the event may not be written.
                if not self._status.state.ending:
                    raise

    def _event(self, level: Level, message: str) -> None:
        entry = LogEntry(self._rig.clock.now_s(), level, message)
        self._recorder.event(entry.time_s, level, "engine", message)
        self._note_lost(self._on_news.tell(entry))

    def _check_abort(self) -> None:
        if self._abort_reason is not None:
            raise self._aborted()

    def _aborted(self) -> Aborted:
        return Aborted(
            str(self._status.step or "before the first step"),
            "the run to go on",
            str(self._abort_reason),
            "the finished steps are on file",
        )

    def _end_well(self) -> None:
        if self._devices.load_frame is not None:
            self._devices.load_frame.hold()
        self._settings.at_end()
        self._event("info", "protocol completed")
        self._recorder.close("completed", "", self._rig.clock.utc())
        self._enter(State.COMPLETED, self._status.step)

    def _end_badly(self, error: BaseException) -> Outcome:
        safing = replace(self._status, state=State.SAFING)
        unsafe = self._safe_state.confirm(meanwhile=lambda: self._publish(safing))
        status: RunStatus = "failed" if self._abort_reason is None else "aborted"
        reason = str(error) or type(error).__name__
        if self._abort_reason is not None and not isinstance(error, Aborted):
            # Name the abort first, because its stop command may have caused the error of the driver.
            reason = f"{self._aborted()}; meanwhile: {reason}"
        if unsafe:
            reason = f"SAFE STATE NOT CONFIRMED, use the emergency stop ({'; '.join(unsafe)}). {reason}"
        # Ignore an error, because the status of the run may be written even if settings and this event
        # cannot.
        with suppress(RigError):
            self._settings.at_end()
        with suppress(RigError):
            self._event("error", reason)
        try:
            self._recorder.close(status, reason, self._rig.clock.utc())
        except RigError as closing:
            reason = f"{reason}; and then {closing}"
        self._enter(State.ABORTED if status == "aborted" else State.FAILED, self._status.step)
        return self._outcome(status, reason, tuple(unsafe))

    def _outcome(self, status: RunStatus, reason: str, unsafe: tuple[str, ...] = ()) -> Outcome:
        at_end = look(self._devices, self._calls, self._safe_state.confirmed)
        self._calls.close()
        end_s = SystemClock().now_s() + self.leaving_s
        listeners = (self._on_status, self._on_step, self._on_news)
        self._note_lost([sentence for each in listeners for sentence in each.close(end_s)])
        return Outcome(
            status,
            reason,
            self._status.steps_done,
            unsafe,
            tuple(self._lost_listeners),
            self._rig.lost_devices,
            tuple(self._records),
            self._recorder.failure is None,
            at_end,
        )
