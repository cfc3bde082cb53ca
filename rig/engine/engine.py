"""The engine: executes the steps of a protocol, and makes the rig safe at the end of every run."""

import math
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import replace

from dic.runfile.schema import Level, RunStatus
from drivers.errors import DeviceError
from drivers.interfaces import LoadFrame, OperatorAction, RotationStage
from rig.devices import Rig
from rig.engine.imaging import take_image
from rig.engine.listeners import Listeners
from rig.engine.monitor import Monitor
from rig.engine.safety import SafeState
from rig.engine.settle import settle
from rig.engine.status import Outcome, State, Status
from rig.engine.watch import Watch
from rig.errors import Aborted, LimitViolation, ProtocolError, RigError
from rig.protocol.protocol import Protocol, RotationProtocol, TensionProtocol
from rig.protocol.step import ProtocolStep, Reading
from rig.recorder import Recorder, StepRecord


class Engine:
    """Runs one protocol once.

    ::

        IDLE --run--> PREPARING --> MOVING --> IMAGING --> COMPLETED
                          ^            ^          |
                          |            +---step---+
                          +--grid, reference------+

        any of these --abort, exception--> SAFING --> ABORTED | FAILED

    PREPARING asks the operator, finds the stage's reference and zeroes the load frame. MOVING lasts until
    the value has settled. IMAGING ends when the step is on file. SAFING first holds the load frame and
    stops the stage, and then closes the run file.

    Parameters
    ----------
    protocol : TensionProtocol or RotationProtocol
    rig : Rig
        Opened devices; the caller closes them.
    recorder : Recorder
        An open run file; the engine closes it.
    on_status : iterable of callable, optional
        Each gets a `Status` at every reading and every change of state: SAFING when the devices have been
        told to stop, COMPLETED, ABORTED and FAILED when the run file is closed.
    on_step : iterable of callable, optional
        Each gets a `StepRecord` when a step is on file.

    Notes
    -----
    Listeners are called on the thread of `run`, which reads no device meanwhile: they should return at once.
    A listener that raises is not called again; the run and the other listeners go on, and the run file and
    the outcome record the failure. A listener that wants to end the run calls `abort`.
    """

    def __init__(
        self,
        protocol: Protocol,
        rig: Rig,
        recorder: Recorder,
        *,
        on_status: Iterable[Callable[[Status], None]] = (),
        on_step: Iterable[Callable[[StepRecord], None]] = (),
    ) -> None:
        watch = Watch(protocol.limits, protocol.loading.increment_n) if protocol.kind == "tension" else None
        self._protocol = protocol
        self._rig = rig
        self._recorder = recorder
        self._monitor = Monitor(rig, recorder, watch)
        self._on_status = Listeners(on_status)
        self._on_step = Listeners(on_step)
        self._lost_listeners: list[str] = []
        self._status = Status(State.IDLE, None, len(protocol.steps()), 0, None)
        self._abort_reason: str | None = None
        self._waiting_for_operator = False
        self._safe_state = SafeState(rig)

    @property
    def status(self) -> Status:
        """The latest snapshot; any thread may read it."""
        return self._status

    @property
    def waiting_for_operator(self) -> bool:
        """Whether the thread that runs the protocol waits for a person, who may never answer."""
        return self._waiting_for_operator

    def run(self) -> Outcome:
        """Execute the protocol and close the run file with the outcome.

        Returns
        -------
        Outcome
            Also returned after an abort and after a failure of known cause. An unknown exception is raised
            again, once the rig is safe and the file is closed; a note on the exception names the devices
            whose safe state is not confirmed.
        """
        try:
            self._require_devices()
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
        """End the run without waiting; any thread or signal handler may call this at any time.

        The safe state is commanded at once. The engine notices the abort within one poll and commands it
        again.
        """
        if self._status.state in (State.COMPLETED, State.ABORTED, State.FAILED):
            return
        if self._abort_reason is None:
            self._abort_reason = reason
        self._safe_state.command()

    def _execute(self, step: ProtocolStep) -> Reading:
        if step.kind == "grid":
            self._prepare_grid(step)
        elif step.kind == "reference":
            self._prepare_reference(step)
        self._command(step)
        settled = self._settle(step)
        self._take(step, settled)
        return settled

    def _prepare_grid(self, step: ProtocolStep) -> None:
        self._enter(State.PREPARING, step)
        self._read()
        if isinstance(self._protocol, RotationProtocol):
            self._bring_to_zero(self._stage, self._protocol.settle.angle_tolerance_deg)
        self._ask(OperatorAction.ATTACH_GRID)

    def _prepare_reference(self, step: ProtocolStep) -> None:
        self._enter(State.PREPARING, step)
        self._ask(OperatorAction.REMOVE_GRID)
        if isinstance(self._protocol, TensionProtocol):
            self._zero_load_frame(self._protocol)

    def _bring_to_zero(self, stage: RotationStage, tolerance_deg: float) -> None:
        if not self._monitor.homed:
            self._event("info", "stage: home")
            stage.home()
            self._wait("homing the stage", "the reference position", lambda _: self._monitor.homed)
        stage.move_to(0.0)
        self._wait("moving to 0 deg", "0 deg", lambda reading: abs(reading.angle_deg) <= tolerance_deg)

    def _zero_load_frame(self, protocol: TensionProtocol) -> None:
        reading = self._read()
        if abs(reading.load_n) > protocol.loading.tare_max_n:
            raise LimitViolation(
                f"{self._status.step}, zeroing the load frame",
                f"a load within {protocol.loading.tare_max_n:g} N",
                f"{reading.load_n:.1f} N",
                "unload the specimen, as a real load must not be zeroed; if the specimen is unloaded, raise "
                f"loading.tare_max_n above {abs(reading.load_n):.1f}",
            )
        self._event("info", f"load frame: zero at {reading.load_n:.1f} N, {reading.displacement_mm:.4f} mm")
        self._load_frame.tare()
        self._wait(
            "zeroing the load frame",
            "load and displacement of zero",
            lambda r: (
                abs(r.load_n) <= protocol.settle.load_tolerance_n
                and abs(r.displacement_mm) <= protocol.settle.displacement_tolerance_mm
            ),
        )

    def _ask(self, action: OperatorAction) -> None:
        self._stand_still()
        self._event("info", f"operator: {action.value}")
        try:
            self._waiting_for_operator = True
            self._check_abort()
            self._rig.operator.perform(action)
        finally:
            self._waiting_for_operator = False

    def _stand_still(self) -> None:
        """Make sure that nothing moves: a person comes near, and a killed program may have left a motion."""
        if self._rig.load_frame is not None:
            self._rig.load_frame.hold()
        self._wait("standing still for the operator", "standstill", lambda _: True)

    def _command(self, step: ProtocolStep) -> None:
        self._enter(State.MOVING, step)
        self._check_abort()
        if step.kind == "load":
            self._load_frame.go_to_load(step.target, step.rate)
        elif step.kind == "displacement":
            self._load_frame.go_to_displacement(step.target, step.rate)
        elif step.kind == "rotation":
            self._stage.move_to(step.target)

    def _settle(self, step: ProtocolStep) -> Reading:
        if math.isnan(step.target):
            return self._wait("settling", "standstill", lambda _: True)
        expected = f"{step.target:.6g} ± {step.tolerance:g}"
        return self._wait("settling", expected, lambda r: abs(step.value(r) - step.target) <= step.tolerance)

    def _wait(self, doing: str, expected: str, within: Callable[[Reading], bool]) -> Reading:
        times = self._protocol.settle
        return settle(
            self._read,
            lambda reading: not reading.moving and within(reading),
            dwell_s=times.dwell_s,
            timeout_s=times.timeout_s,
            poll_s=times.poll_s,
            clock=self._rig.clock,
            step=f"{self._status.step}, {doing}",
            expected=expected,
        )

    def _take(self, step: ProtocolStep, settled: Reading) -> None:
        """Take and record the images of all cameras, then the step."""
        self._enter(State.IMAGING, step)
        images = self._protocol.images
        frames: dict[str, tuple[int, int]] = {}
        for _ in range(images.per_step):
            for name, camera in self._rig.cameras.items():
                frame = take_image(
                    name,
                    camera,
                    timeout_s=images.timeout_s,
                    clock=self._rig.clock,
                    step=str(step),
                    warn=lambda message: self._event("warning", message),
                )
                row = self._recorder.frame(name, frame)
                first, count = frames.get(name, (row, 0))
                frames[name] = (first, count + 1)
                # Read after every image: a slow camera must delay neither the watchdog nor the limits.
                self._read()
        record = StepRecord(step, settled, frames)
        self._recorder.step(record)
        self._publish(replace(self._status, steps_done=self._status.steps_done + 1))
        self._note_lost(self._on_step.tell(record, ending=False))

    def _read(self) -> Reading:
        self._check_abort()
        reading = self._monitor.read(str(self._status.step))
        self._publish(replace(self._status, reading=reading))
        self._check_abort()
        return reading

    def _enter(self, state: State, step: ProtocolStep | None) -> None:
        self._publish(replace(self._status, state=state, step=step))

    def _publish(self, status: Status) -> None:
        self._status = status
        self._note_lost(self._on_status.tell(status, ending=status.state.ending))

    def _note_lost(self, listeners: list[str]) -> None:
        self._lost_listeners += listeners
        for listener in listeners:
            try:
                self._event("warning", listener)
            except RigError:
                # When a run ends, the run file may be closed, or may itself be the failure.
                if not self._status.state.ending:
                    raise

    def _event(self, level: Level, message: str) -> None:
        self._recorder.event(self._rig.clock.now_s(), level, "engine", message)

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

    def _require_devices(self) -> None:
        needed = "load_frame" if self._protocol.kind == "tension" else "stage"
        if getattr(self._rig, needed) is None:
            raise ProtocolError(
                f"a {self._protocol.kind} protocol",
                f"a [{needed}] in the rig file",
                "none",
                f"add a [{needed}], or run the protocol on a rig that has one",
            )

    @property
    def _load_frame(self) -> LoadFrame:
        assert self._rig.load_frame is not None  # _require_devices
        return self._rig.load_frame

    @property
    def _stage(self) -> RotationStage:
        assert self._rig.stage is not None  # _require_devices
        return self._rig.stage

    def _end_well(self) -> None:
        if self._rig.load_frame is not None:
            self._rig.load_frame.hold()
        self._event("info", "protocol completed")
        self._recorder.close("completed", "", self._rig.clock.utc())
        self._enter(State.COMPLETED, self._status.step)

    def _end_badly(self, error: BaseException) -> Outcome:
        safing = replace(self._status, state=State.SAFING)
        unsafe = self._safe_state.confirm(meanwhile=lambda: self._publish(safing))
        status: RunStatus = "failed" if self._abort_reason is None else "aborted"
        reason = str(error) or type(error).__name__
        if self._abort_reason is not None and not isinstance(error, Aborted):
            # The driver's error may be a consequence of the stop that the abort commanded.
            reason = f"{self._aborted()}; meanwhile: {reason}"
        if unsafe:
            reason = f"SAFE STATE NOT CONFIRMED, use the emergency stop ({'; '.join(unsafe)}). {reason}"
        # A file that refuses the event may still accept its end; an error of closing is reported below.
        with suppress(RigError):
            self._event("error", reason)
        try:
            self._recorder.close(status, reason, self._rig.clock.utc())
        except RigError as closing:
            reason = f"{reason}; and then {closing}"
        self._enter(State.ABORTED if status == "aborted" else State.FAILED, self._status.step)
        return self._outcome(status, reason, tuple(unsafe))

    def _outcome(self, status: RunStatus, reason: str, unsafe: tuple[str, ...] = ()) -> Outcome:
        return Outcome(status, reason, self._status.steps_done, unsafe, tuple(self._lost_listeners))
