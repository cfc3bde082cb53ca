"""The devices of a rig as the engine calls them. Each call has a deadline and runs on the device's thread."""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext, suppress
from dataclasses import dataclass, field, replace
from typing import TypeAlias, TypeVar

from drivers.errors import DeviceError, DeviceFault
from drivers.interfaces import (
    Camera,
    CameraInfo,
    Frame,
    InterlockState,
    LoadFrame,
    LoadFrameState,
    Operator,
    OperatorAction,
    RotationStage,
    StageState,
)
from rig.devices import OPENING_S, OpenedInterlock, Rig
from rig.engine.calls import CAMERA_MARGIN_S, NEVER, STOPPING_S, Call, Calls, Deadline
from rig.protocol.step import Quantity
from rig.threads import Bounded

OnQuestion: TypeAlias = Callable[[OperatorAction, str], AbstractContextManager[None]]
"""Type of a function that is called before a question with the action and a notice by the operator's driver.
The function returns a context manager, which the engine leaves after the answer."""


def unannounced(_: OperatorAction, __: str) -> AbstractContextManager[None]:
    """Do nothing before a question. This function is the default of `on_question`."""
    return nullcontext()


T = TypeVar("T")


@dataclass(frozen=True)
class CalledLoadFrame:
    """A load frame that is called with deadlines. All methods but `begin_read` wait until the call ends."""

    frame: LoadFrame
    calls: Calls
    deadline: Deadline

    def begin_read(self) -> Call[LoadFrameState]:
        """Begin to read the state."""
        return self.calls.begin("load_frame", "read", self.frame.read, self.deadline)

    def go_to_load(self, load_n: float, rate_n_s: float) -> None:
        """Command a ramp to a load, and wait until the driver has sent the command."""
        self._do(f"go to {load_n:g} N", lambda: self.frame.go_to_load(load_n, rate_n_s))

    def go_to_displacement(self, displacement_mm: float, speed_mm_s: float) -> None:
        """Command a move to a crosshead position, and wait until the driver has sent the command."""
        self._do(
            f"go to {displacement_mm:g} mm",
            lambda: self.frame.go_to_displacement(displacement_mm, speed_mm_s),
        )

    def tare(self) -> None:
        """Set the zero points of load and displacement to the present readings."""
        self._do("tare", self.frame.tare)

    def hold(self) -> None:
        """Hold the crosshead when nothing should move, for example before a question."""
        self.calls.do("load_frame", "hold", self.frame.hold, Deadline(STOPPING_S))

    def _do(self, action: str, function: Callable[[], None]) -> None:
        self.calls.do("load_frame", action, function, self.deadline)


@dataclass(frozen=True)
class CalledStage:
    """A stage that is called with deadlines. All methods but `begin_read` wait until the call ends."""

    stage: RotationStage
    calls: Calls
    deadline: Deadline

    def begin_read(self) -> Call[StageState]:
        """Begin to read position and status."""
        return self.calls.begin("stage", "read", self.stage.read, self.deadline)

    def home(self) -> None:
        """Command the search for the reference position."""
        self.calls.do("stage", "home", self.stage.home, self.deadline)

    def move_to(self, angle_deg: float) -> None:
        """Command a move to an absolute angle."""
        self.calls.do(
            "stage", f"move to {angle_deg:g} deg", lambda: self.stage.move_to(angle_deg), self.deadline
        )


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

        Raises
        ------
        CameraLost
            If the camera's driver raises a `DeviceError`, and the camera can be opened again.
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

    def _perform(self, action: OperatorAction) -> None:
        notice = getattr(self.operator, "notice", None)
        with self.on_question(action, "" if notice is None else notice(action)):
            self.operator.perform(action)


@dataclass(frozen=True)
class CalledInterlock:
    """An interlock that is called with a deadline, and is read together with load frame and stage."""

    name: str
    interlock: OpenedInterlock
    calls: Calls
    deadline: Deadline

    def begin_read(self) -> Call[InterlockState]:
        """Begin to read the value."""
        return self.calls.begin(f"interlocks.{self.name}", "read", self.interlock.device.read, self.deadline)

    def require_good(self, state: InterlockState, step: str) -> None:
        """Raise `InterlockOpen` if the interlock's value is out of bounds."""
        self.interlock.require_good(self.name, state, step)


@dataclass(frozen=True)
class Devices:
    """All devices of a rig. The function `called` wraps each device so that every call has a deadline."""

    operator: CalledOperator
    stage: CalledStage | None = None
    load_frame: CalledLoadFrame | None = None
    cameras: dict[str, CalledCamera] = field(default_factory=dict)
    interlocks: tuple[CalledInterlock, ...] = ()

    def go_to(self, quantity: Quantity, target: float, rate: float) -> None:
        """Command a motion and return at once. The rig must have the device."""
        if quantity == "rotation":
            assert self.stage is not None
            self.stage.move_to(target)
            return
        assert self.load_frame is not None
        if quantity == "load":
            self.load_frame.go_to_load(target, rate)
        else:
            self.load_frame.go_to_displacement(target, rate)

    def hold(self) -> None:
        """Hold the load frame, if the rig has one. `SafeState` commands all other holds."""
        if self.load_frame is not None:
            self.load_frame.hold()


def called(rig: Rig, calls: Calls, on_question: OnQuestion = unannounced) -> Devices:
    """Return the devices of a rig, wrapped so that every call has a deadline.

    `on_question` is described for `CalledOperator`.
    """
    deadline = Deadline(
        rig.call_timeout_s,
        "check the device and its cable; if its calls may take longer, raise call_timeout_s in [rig] above "
        f"{rig.call_timeout_s:g}",
    )
    return Devices(
        CalledOperator(rig.operator, calls, on_question),
        None if rig.stage is None else CalledStage(rig.stage, calls, deadline),
        None if rig.load_frame is None else CalledLoadFrame(rig.load_frame, calls, deadline),
        {
            name: CalledCamera(name, camera, calls, rig.reopen.get(name))
            for name, camera in rig.cameras.items()
        },
        tuple(CalledInterlock(name, each, calls, deadline) for name, each in rig.interlocks.items()),
    )
