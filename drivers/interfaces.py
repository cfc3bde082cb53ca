"""What the rig asks of a device, and what a device answers.

These protocols are the whole contract: a driver implements one of them, a simulated camera does too,
and third parties' drivers found by entry point (`drivers.registry`) need nothing else.
Every call returns soon or raises a `DeviceError`; whoever waits for motion has a deadline of his own.
"""

from dataclasses import dataclass
from datetime import datetime
from enum import Enum
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from drivers.clock import Clock


@dataclass(frozen=True)
class DeviceInfo:
    """Who a device is, as it says itself; written into the run file."""

    vendor: str
    model: str
    serial: str
    firmware: str = ""
    simulated: bool = False


@dataclass(frozen=True)
class CameraInfo(DeviceInfo):
    """A camera's identity and picture format; `bits` are the significant bits of a pixel."""

    width_px: int = 0
    height_px: int = 0
    bits: int = 8


@dataclass(frozen=True)
class Frame:
    """One image as the sensor gave it.

    Attributes
    ----------
    image : ndarray of uint8 or uint16, shape (height, width)
    exposed_s : float
        When the exposure began at the earliest, on the rig's monotonic clock: what a driver does not know of
        the delay counts against the frame.
    received_s : float
        When the frame reached the program, on the same clock.
    utc : datetime
        The date of `exposed_s`.
    sequence : int
        The camera's own frame counter; a gap means lost frames.
    flags : int
        The driver's buffer flags, 0 for a good frame.
    exposure_us, gain : float
        As read back from the camera.
    """

    image: NDArray[np.uint8] | NDArray[np.uint16]
    exposed_s: float
    received_s: float
    utc: datetime
    sequence: int
    flags: int
    exposure_us: float
    gain: float


class Camera(Protocol):
    """A camera that can prove how old its frames are."""

    info: CameraInfo

    def grab(self, timeout_s: float) -> Frame:
        """Return a frame whose exposure began after this call; `DeviceTimeout` after `timeout_s`."""

    def close(self) -> None:
        """Release the camera; harmless when repeated."""


@dataclass(frozen=True)
class StageState:
    """Where a rotation stage is.

    `warnings` are the device's own flags. A state is read fresh from the device, at `time_s` of the clock.
    """

    angle_deg: float
    moving: bool
    homed: bool
    warnings: tuple[str, ...]
    time_s: float


class RotationStage(Protocol):
    """A motorised rotation about one axis; positive turns X towards Y."""

    info: DeviceInfo

    def read(self) -> StageState:
        """Ask for position and status; `DeviceFault` if the device reports that motion failed."""

    def home(self) -> None:
        """Begin to find the reference position; `read` tells when it is done."""

    def move_to(self, angle_deg: float) -> None:
        """Begin to move to an absolute angle; refused out of limits or without a reference."""

    def stop(self) -> None:
        """Stop now, ahead of everything that waits, until the device says that it stands still."""

    def close(self) -> None:
        """Release the port; harmless when repeated. It does not move or stop anything."""


@dataclass(frozen=True)
class LoadFrameState:
    """What a load frame reports, read in one coherent block at `time_s` of the rig's clock.

    Attributes
    ----------
    load_n, displacement_mm : float
        Tensile load and crosshead displacement, both positive in tension.
    moving, at_target, holding : bool
        What the machine does now.
    sample : int
        The machine's own sample counter: a value that does not grow is stale.
    faults : tuple of str
        Names of active faults, trips and limits; empty when all is well.
    """

    load_n: float
    displacement_mm: float
    moving: bool
    at_target: bool
    holding: bool
    sample: int
    faults: tuple[str, ...]
    time_s: float


@dataclass(frozen=True)
class LoadFrameLimits:
    """The limits that are active in the machine, as read back from it."""

    load_min_n: float
    load_max_n: float
    displacement_min_mm: float
    displacement_max_mm: float
    speed_max_mm_s: float
    load_rate_max_n_s: float


class LoadFrame(Protocol):
    """A tensile load frame in load or displacement control. Its safe state is stop and hold, not unload."""

    info: DeviceInfo
    limits: LoadFrameLimits

    def read(self) -> LoadFrameState:
        """Read the state and feed the watchdog; raises on stale or impossible values and a lost link."""

    def go_to_load(self, load_n: float, rate_n_s: float) -> None:
        """Begin to approach a load; refused beyond the limits."""

    def go_to_displacement(self, displacement_mm: float, speed_mm_s: float) -> None:
        """Begin to approach a crosshead position; refused beyond the limits."""

    def hold(self) -> None:
        """Stop and hold position now, ahead of everything that waits, until the machine confirms it."""

    def tare(self) -> None:
        """Make the present load and displacement the zero."""

    def close(self) -> None:
        """Release the link; harmless when repeated. It does not move or stop anything."""


class OperatorAction(Enum):
    """What a protocol asks of the person at the rig."""

    ATTACH_GRID = "attach the calibration grid to the specimen"
    REMOVE_GRID = "remove the calibration grid"


class Operator(Protocol):
    """The person at the rig, or whoever stands in for that person."""

    def perform(self, action: OperatorAction) -> None:
        """Return when the action was done; raise `DeviceError` when it was refused."""


@dataclass(frozen=True)
class OpenContext:
    """What a driver gets besides its own settings.

    Attributes
    ----------
    name : str
        The device's name in the rig file, for messages.
    clock : Clock
    environment : object or None
        The simulated rig, if there is one: its `clock`, and in `addresses` the ports of its servers by name;
        a rig file refers to them as ``@name``. Simulated devices know its concrete type.
    """

    name: str
    clock: Clock
    environment: Any = None
