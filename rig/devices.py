"""Open the devices of a rig file, and close every opened device at the end, even after an error."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import partial
from typing import Any, cast

from drivers.clock import Clock, SystemClock
from drivers.errors import ConfigurationError, DeviceError, DeviceTimeout
from drivers.interfaces import (
    Camera,
    DeviceInfo,
    Interlock,
    InterlockState,
    LoadFrame,
    OpenContext,
    Operator,
    RotationStage,
)
from drivers.signals import ChannelDevice, TriggerOutput
from rig.answers import checked, require_identity
from rig.camera_line import CameraLine
from rig.errors import InterlockOpen
from rig.limit_settings import RigLimits
from rig.rigfile import CALL_TIMEOUT_S, DeviceEntry, RigFile, TriggerEntry, TriggerEvent
from rig.threads import Bounded

OPENING_S = 60.0
"""Longest real time in s for opening one device. A camera on a network may take 20 s."""
CLOSING_S = 10.0
"""Longest real time in s for closing one device. Before this, all motion has been stopped."""


@dataclass(frozen=True)
class OpenedInterlock:
    """An opened interlock, with the range of its value in which a run may continue."""

    device: Interlock
    allowed_min: float | None
    allowed_max: float | None

    @property
    def unit(self) -> str:
        """The unit as it follows a number: a space and the unit, or an empty text for a contact."""
        return f" {self.device.unit}" if self.device.unit else ""

    @property
    def allowed(self) -> str:
        """The allowed range in words, such as "at least 1"."""
        ends = (("at least", self.allowed_min), ("at most", self.allowed_max))
        return " and ".join(f"{words} {bound:g}{self.unit}" for words, bound in ends if bound is not None)

    def allows(self, state: InterlockState) -> bool:
        """Return True if the value of the interlock is within its allowed range."""
        low, high, value = self.allowed_min, self.allowed_max, state.value
        # Write the comparisons so that NaN is outside of every range.
        return (low is None or value >= low) and (high is None or value <= high)

    def require_good(self, name: str, state: InterlockState, step: str) -> None:
        """Raise `InterlockOpen` if the value of the interlock is outside its allowed range."""
        if not self.allows(state):
            raise InterlockOpen(
                step,
                f"interlock {name} {self.allowed}",
                f"{state.value:g}{self.unit}",
                f"find out why the interlock {name} does not allow a run, then start again",
            )


@dataclass(frozen=True)
class OpenedTrigger:
    """An opened output line, with the event of a run at which it gives a pulse."""

    device: TriggerOutput
    at: TriggerEvent


@dataclass(frozen=True)
class Rig:
    """The opened devices of a rig, with the cameras by name. A missing stage or load frame is None.

    Attributes
    ----------
    call_timeout_s : float
        Deadline of one call of the load frame or the stage.
    lost : dict of str to str
        For each device in whose driver a call hangs, the name of the call. Entries are added during a run and
        at its end.
    reopen : dict of str to callable
        For each camera a function that opens the camera again after it was closed.
    limits : RigLimits
        The table [limits] of the rig file.
    interlocks : dict of str to OpenedInterlock
    channels : dict of str to ChannelDevice
        The channel devices.
    measured : dict of str to str
        The signals that are the load and the displacement of a load frame that is only read, by quantity.
    triggers : dict of str to OpenedTrigger
        The output lines.
    """

    clock: Clock
    operator: Operator
    cameras: dict[str, Camera]
    stage: RotationStage | None = None
    load_frame: LoadFrame | None = None
    virtual: bool = False
    call_timeout_s: float = CALL_TIMEOUT_S
    lost: dict[str, str] = field(default_factory=dict)
    reopen: Mapping[str, Callable[[], Camera]] = field(default_factory=dict)
    limits: RigLimits = field(default_factory=RigLimits)
    interlocks: Mapping[str, OpenedInterlock] = field(default_factory=dict)
    channels: Mapping[str, ChannelDevice] = field(default_factory=dict)
    measured: Mapping[str, str] = field(default_factory=dict)
    triggers: Mapping[str, OpenedTrigger] = field(default_factory=dict)

    @property
    def lost_devices(self) -> tuple[str, ...]:
        """One sentence for each lost device."""
        return tuple(
            f"{device}: its driver hangs in {call}; the device is not closed"
            for device, call in self.lost.items()
        )

    @property
    def simulated(self) -> bool:
        """True if the rig file declares a simulation or if any device of the rig is simulated."""
        infos: list[DeviceInfo] = [camera.info for camera in self.cameras.values()]
        infos += [device.info for device in (self.stage, self.load_frame) if device is not None]
        infos += [interlock.device.info for interlock in self.interlocks.values()]
        infos += [device.info for device in self.channels.values()]
        infos += [trigger.device.info for trigger in self.triggers.values()]
        return self.virtual or any(info.simulated for info in infos)


@contextmanager
def open_rig(
    rig_file: RigFile,
    relays: Mapping[str, str] | None = None,
    *,
    failed: dict[str, str] | None = None,
    opening_s: float = OPENING_S,
    closing_s: float = CLOSING_S,
) -> Iterator[Rig]:
    """Open all devices of a rig file, and close the devices in reverse order at the end.

    The simulated environment is opened first if the rig file has one. Closing a device does not start or stop
    any motion. At the end of a run, the engine stops all motion before the devices are closed. A device in
    whose driver a call hangs is not closed, so that the program can end.

    Parameters
    ----------
    rig_file : RigFile
    relays : mapping of str to str, optional
        For each device that a guardian watches, the address of its relay, or an empty text.
    failed : dict of str to str, optional
        If given, a stage, a load frame, a camera or an interlock that cannot be opened raises no error. The
        rig is opened without this device, and the dictionary receives the device's name and the reason.
    opening_s, closing_s : float
        Longest real time for opening and for closing one device.

    Raises
    ------
    DeviceError
        If a device cannot be opened, or not in time. The devices that are already open are closed.
    """
    with ExitStack() as stack:
        opener = _Opener(stack, relays or {}, failed, opening_s, closing_s, rig_file.call_timeout_s)
        if rig_file.simulation is not None:
            opener.open_environment(rig_file.simulation)
        stage, load_frame = opener.open(rig_file.stage), opener.open(rig_file.load_frame)
        cameras = {name: opener.open(entry) for name, entry in rig_file.cameras.items()}
        operator = opener.open(rig_file.operator)
        interlocks = {
            name: OpenedInterlock(device, each.allowed_min, each.allowed_max)
            for name, each in rig_file.interlocks.items()
            if (device := opener.open(each.device)) is not None
        }
        channels = {
            name: device
            for name, entry in rig_file.channels.items()
            if (device := opener.open(entry)) is not None
        }
        triggers = {
            name: OpenedTrigger(device, each.at)
            for name, each in rig_file.triggers.items()
            if (device := opener.open_trigger(each)) is not None
        }
        measured = rig_file.measured_load
        yield Rig(
            clock=opener.clock,
            operator=operator,
            cameras={name: camera for name, camera in cameras.items() if camera is not None},
            stage=stage,
            load_frame=load_frame,
            virtual=rig_file.simulated or rig_file.simulation is not None,
            call_timeout_s=rig_file.call_timeout_s,
            lost=opener.lost,
            reopen={name: partial(opener.reopen, entry) for name, entry in rig_file.cameras.items()},
            limits=rig_file.limits,
            interlocks=interlocks,
            channels=channels,
            measured={} if measured is None else measured.signals,
            triggers=triggers,
        )


def require_interlocks(rig: Rig) -> None:
    """Read every interlock once.

    Raise `InterlockOpen` if the value of an interlock is outside its allowed range, and `DeviceError` if an
    interlock cannot be read.
    """
    for name, interlock in rig.interlocks.items():
        first = Bounded(f"interlocks.{name}", "read", interlock.device.read)
        state = first.result(rig.call_timeout_s, "check the interlock and its cable")
        interlock.require_good(name, state, "before the start")


class _Opener:
    """Opens devices, and lets an exit stack close them. `lost` is described for `Rig`."""

    def __init__(
        self,
        stack: ExitStack,
        relays: Mapping[str, str],
        failed: dict[str, str] | None,
        opening_s: float,
        closing_s: float,
        call_timeout_s: float,
    ) -> None:
        self._stack, self._relays, self._failed = stack, relays, failed
        self._opening_s, self._closing_s = opening_s, closing_s
        self._call_timeout_s = call_timeout_s
        self._environment: Any = None
        self._patience_s = 0.0
        self.clock: Clock = SystemClock()
        # the cameras as they are open now
        self._cameras: dict[str, Camera] = {}
        self.lost: dict[str, str] = {}

    def open_environment(self, entry: DeviceEntry) -> None:
        """Open the simulated environment. All devices that are opened later use its clock."""
        self._environment = self.open(entry)
        self.clock = self._environment.clock
        self._patience_s = getattr(self._environment, "patience_s", 0.0)

    def open(self, entry: DeviceEntry | None) -> Any:
        """Open a device. Return None if the rig has no such device, or if opening failed and `failed` has the
        reason."""
        if entry is None:
            return None
        guarded, relay = entry.name in self._relays, self._relays.get(entry.name, "")
        context = OpenContext(
            entry.name,
            self.clock,
            self._environment,
            guarded,
            relay,
            self._call_timeout_s,
            self._patience_s,
        )
        try:
            device = _open(entry, context, self._opening_s)
            if device is not None:
                self._close_at_end(entry, device)
            require_identity(entry.spec.kind, entry.name, device)
        except (DeviceError, ConfigurationError) as error:
            if self._failed is None or entry.spec.kind in ("environment", "operator"):
                raise
            self._failed[entry.name] = str(error)
            return None
        if entry.spec.kind == "camera":
            self._cameras[entry.name] = device
        return checked(entry.spec.kind, entry.name, device, self.clock)

    def open_trigger(self, trigger: TriggerEntry) -> TriggerOutput | None:
        """Open an output line, which may belong to a camera that is open. Return None as `open` does."""
        if trigger.device is not None:
            return cast("TriggerOutput | None", self.open(trigger.device))
        name = f"cameras.{trigger.camera}"
        # the camera could not be opened
        return CameraLine(lambda: self._cameras[name]) if name in self._cameras else None

    def reopen(self, entry: DeviceEntry) -> Camera:
        """Open a camera again after it was closed."""
        context = OpenContext(entry.name, self.clock, self._environment)
        camera: Camera = entry.spec.open(entry.settings, context)
        self._close_at_end(entry, camera)
        require_identity(entry.spec.kind, entry.name, camera)
        self._cameras[entry.name] = camera
        return cast(Camera, checked(entry.spec.kind, entry.name, camera, self.clock))

    def _close_at_end(self, entry: DeviceEntry, device: Any) -> None:
        self._stack.callback(_close, entry.name, device, self.lost, self._closing_s)


def _open(entry: DeviceEntry, context: OpenContext, within_s: float) -> Any:
    opening = Bounded(entry.name, "open", lambda: entry.spec.open(entry.settings, context), undo=_release)
    return opening.result(within_s, "check the device and its cable, then start the program again")


def _close(name: str, device: Any, lost: dict[str, str], within_s: float) -> None:
    if name in lost:
        return
    closing = Bounded(name, "close", lambda: _release(device))
    try:
        closing.result(within_s, "start the program again")
    except DeviceTimeout:
        if not closing.hangs:
            raise
        # Do not raise the error, so that the devices that were opened earlier are still closed.
        lost[name] = f"close, which has not returned for {within_s:g} s"


def _release(device: Any) -> None:
    if hasattr(device, "close"):  # the method `close` is optional for an operator
        device.close()
