"""The devices of a rig as the engine calls them. Each call has a deadline and runs on the device's thread."""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext, suppress
from dataclasses import dataclass, field, replace
from typing import Any, Generic, TypeAlias, TypeVar, cast

from drivers.errors import DeviceError, DeviceFault
from drivers.interfaces import (
    AsksQuestions,
    Camera,
    CameraInfo,
    ChangesSpeed,
    Frame,
    InterlockState,
    LoadFrame,
    LoadFrameState,
    Operator,
    OperatorAction,
    OperatorQuestion,
    RotationStage,
    StageState,
)
from rig.devices import OPENING_S, OpenedInterlock, Rig
from rig.engine.calls import CAMERA_MARGIN_S, NEVER, STOPPING_S, Call, Calls, Deadline
from rig.protocol.step import Quantity
from rig.threads import Bounded

Asked: TypeAlias = OperatorAction | OperatorQuestion
"""What the operator is asked: an action of every test, or a question of the protocol."""
OnQuestion: TypeAlias = Callable[[Asked, str], AbstractContextManager[None]]
"""Type of a function that is called before a question, with what is asked and a notice by the operator's
driver. The function returns a context manager, which the engine leaves after the answer."""


def unannounced(_: Asked, __: str) -> AbstractContextManager[None]:
    """Do nothing before a question. This function is the default of `on_question`."""
    return nullcontext()


D = TypeVar("D")
S = TypeVar("S")
T = TypeVar("T")


@dataclass(frozen=True)
class CalledDevice(Generic[D, S]):
    """A load frame, a stage or an interlock that is called with deadlines. `read` reads its state."""

    name: str
    driver: D
    read: Callable[[], S]
    calls: Calls
    deadline: Deadline

    def begin_read(self) -> Call[S]:
        """Begin to read the state."""
        return self.calls.begin(self.name, "read", self.read, self.deadline)

    def do(self, action: str, command: Callable[[], None]) -> None:
        """Give a command, and wait until the driver has sent it."""
        self.calls.do(self.name, action, command, self.deadline)


class CameraLost(Exception):
    """Raised if a camera delivers no image but can be opened again. `error` is the error of the camera's
    driver."""

    def __init__(self, name: str, error: DeviceError) -> None:
        super().__init__(name, error)
        self.name, self.error = name, error


@dataclass(frozen=True)
class CalledCamera:
    """A camera that is called with deadlines. The engine monitors stage and load frame during each call.

    `reopen` opens the camera again after it was closed.
    """

    name: str
    camera: Camera
    calls: Calls
    reopen: Callable[[], Camera] | None = None

    @property
    def info(self) -> CameraInfo:
        """Identity and picture format."""
        return self.camera.info

    def grab(self, timeout_s: float) -> Frame:
        """Return a frame whose exposure began after this call.

        Raise `CameraLost` if the camera's driver raises a `DeviceError`, and the camera can be opened again.
        """
        deadline = Deadline(
            timeout_s + CAMERA_MARGIN_S, "check the camera and its cable, or raise images.timeout_s"
        )
        taken = self._do("grab", lambda: self.camera.grab(timeout_s), deadline)
        if not isinstance(taken, DeviceError):
            return taken
        if self.reopen is None:
            raise taken
        raise CameraLost(self.name, taken)

    def reopened(self) -> "CalledCamera | DeviceError":
        """Close and open the camera. Return the opened camera, or the error of its driver."""
        if self.reopen is None:
            raise ValueError(f"cameras.{self.name} cannot be opened again")
        reopen = self.reopen

        def again() -> Camera:
            with suppress(DeviceError):
                self.camera.close()
            return reopen()

        camera = self._do("open again", again, Deadline(OPENING_S))
        if isinstance(camera, DeviceError):
            return camera
        if camera.info != self.info:
            camera.close()
            return DeviceFault(
                f"cameras.{self.name}",
                "open again",
                f"the same camera as before, {self.info}",
                f"{camera.info}",
                "plug in the camera that the run began with",
            )
        return replace(self, camera=camera)

    def _do(self, action: str, function: Callable[[], T], deadline: Deadline) -> "T | DeviceError":
        """Call the camera's driver. Return its result, or the `DeviceError` that it raised.

        Stage and load frame are monitored during the call. An error of one of them is raised.
        """

        def value_or_error() -> T | DeviceError:
            try:
                return function()
            except DeviceError as error:
                return error

        call = self.calls.begin(f"cameras.{self.name}", action, value_or_error, deadline)
        return self.calls.finish(call, watched=True)


@dataclass(frozen=True)
class CalledOperator:
    """The person at the rig, who has no deadline. While the person is asked, the engine monitors all devices.

    `on_question` is called on the operator's thread.
    """

    operator: Operator
    calls: Calls
    on_question: OnQuestion = unannounced

    def perform(self, action: OperatorAction) -> None:
        """Ask for an action, and return when it is done. If the run ends before, withdraw the question."""
        call = self.calls.begin("operator", action.value, lambda: self._perform(action), NEVER)
        try:
            self.calls.finish(call, watched=True)
        finally:
            if not call.done and (close := getattr(self.operator, "close", None)):
                Bounded("operator", "close", close).start()

    def ask(self, question: OperatorQuestion, answered: Callable[[], bool]) -> None:
        """Ask a question of the protocol, and return when it is answered: by the person, or elsewhere.

        `answered` returns True if the question was answered elsewhere. The operator's driver is then told to
        withdraw it. The driver must have the methods of `drivers.interfaces.AsksQuestions`.
        """
        asker = cast(AsksQuestions, self.operator)
        call = self.calls.begin(
            "operator", "answer a question", lambda: self._announced(question, asker.ask), NEVER
        )
        try:
            self.calls.finish_unless(call, answered)
        finally:
            if not call.done:
                Bounded("operator", "withdraw", asker.withdraw).start()

    def _perform(self, action: OperatorAction) -> None:
        self._announced(action, self.operator.perform)

    def _announced(self, asked: T, act: Callable[[T], None]) -> None:
        notice = getattr(self.operator, "notice", None)
        told: Any = asked
        with self.on_question(told, "" if notice is None else notice(asked)):
            act(asked)


@dataclass(frozen=True)
class Devices:
    """All devices of a rig. The function `called` wraps each device so that every call has a deadline."""

    operator: CalledOperator
    stage: CalledDevice[RotationStage, StageState] | None = None
    load_frame: CalledDevice[LoadFrame, LoadFrameState] | None = None
    cameras: dict[str, CalledCamera] = field(default_factory=dict)
    interlocks: dict[str, CalledDevice[OpenedInterlock, InterlockState]] = field(default_factory=dict)

    def go_to(self, quantity: Quantity, target: float, rate: float) -> None:
        """Command a motion and return at once. The rig must have the device."""
        stage, frame = self.stage, self.load_frame
        if quantity == "rotation":
            assert stage is not None
            stage.do(f"move to {target:g} deg", lambda: stage.driver.move_to(target))
            return
        assert frame is not None
        if quantity == "load":
            frame.do(f"go to {target:g} N", lambda: frame.driver.go_to_load(target, rate))
        else:
            frame.do(f"go to {target:g} mm", lambda: frame.driver.go_to_displacement(target, rate))

    @property
    def can_change_speed(self) -> bool:
        """True if the load frame can change the speed of a motion to a displacement."""
        return self.load_frame is not None and hasattr(self.load_frame.driver, "change_speed")

    def change_speed(self, speed_mm_s: float) -> None:
        """Change the speed of the present motion to a displacement, as `ChangesSpeed` describes.

        Return when the machine has confirmed it, within the deadline of a call. Raise `DeviceFault` if the
        load frame cannot do this, or refuses it.
        """
        frame, action = self.load_frame, f"change the speed to {speed_mm_s:g} mm/s"
        if frame is None or not self.can_change_speed:
            raise DeviceFault(
                "load_frame",
                action,
                "a load frame that changes the speed of a motion",
                "one that cannot",
                "take a protocol without control of a strain rate, or another rig",
            )
        changer = cast(ChangesSpeed, frame.driver)
        frame.do(action, lambda: changer.change_speed(speed_mm_s))

    def stop(self) -> None:
        """Hold the load frame and stop the stage, for a pause of the run."""
        self.hold()
        if (stage := self.stage) is not None:
            stage.calls.do(stage.name, "stop", stage.driver.stop, Deadline(STOPPING_S))

    def hold(self) -> None:
        """Hold the load frame when nothing should move, for example before a question.

        `SafeState` commands all other holds. Without a load frame, do nothing.
        """
        if (frame := self.load_frame) is not None:
            frame.calls.do(frame.name, "hold", frame.driver.hold, Deadline(STOPPING_S))


def called(rig: Rig, calls: Calls, on_question: OnQuestion = unannounced) -> Devices:
    """Return the devices of a rig, wrapped so that every call has a deadline.

    `on_question` is described for `CalledOperator`.
    """
    deadline = Deadline(
        rig.call_timeout_s,
        "check the device and its cable; if its calls may take longer, raise call_timeout_s in [rig] above "
        f"{rig.call_timeout_s:g}",
    )
    stage, frame = rig.stage, rig.load_frame
    return Devices(
        CalledOperator(rig.operator, calls, on_question),
        None if stage is None else CalledDevice("stage", stage, stage.read, calls, deadline),
        None if frame is None else CalledDevice("load_frame", frame, frame.read, calls, deadline),
        {
            name: CalledCamera(name, camera, calls, rig.reopen.get(name))
            for name, camera in rig.cameras.items()
        },
        {
            name: CalledDevice(f"interlocks.{name}", each, each.device.read, calls, deadline)
            for name, each in rig.interlocks.items()
        },
    )
