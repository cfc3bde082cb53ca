"""Interfaces between the rig and its devices.

These protocols are the complete contract. Every driver implements one of them: real devices, simulated
devices, and third parties' drivers found by entry point (`drivers.registry`). Every call returns soon or
raises a `DeviceError`. A caller that waits for motion must use a deadline of its own.
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
    """Identity of a device as reported by the device; written into the run file."""

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
    """One image, unchanged since the sensor.

    Attributes
    ----------
    image : ndarray of uint8 or uint16, shape (height, width)
    exposed_s : float
        Earliest possible start of the exposure, on the rig's monotonic clock. A driver subtracts the longest
        possible delay where the delay is unknown.
    received_s : float
        Time at which the program received the frame, on the same clock.
    utc : datetime
        The date of `exposed_s`.
    sequence : int
        The camera's frame counter; a gap means lost frames.
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
    """A camera with an upper limit for the age of each frame."""

    info: CameraInfo

    def grab(self, timeout_s: float) -> Frame:
        """Return a frame whose exposure began after this call; `DeviceTimeout` after `timeout_s`."""

    def close(self) -> None:
        """Release the camera; harmless when repeated."""


@dataclass(frozen=True)
class StageState:
    """Position and status of a rotation stage.

    `warnings` are the warning flags of the device. `time_s` is the time on the clock at which the state was
    read from the device.
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
        """Begin to find the reference position; `read` reports the end of the search."""

    def move_to(self, angle_deg: float) -> None:
        """Begin to move to an absolute angle; refused beyond the limits or without a reference."""

    def stop(self) -> None:
        """Stop before any waiting command, and wait until the device reports standstill."""

    def close(self) -> None:
        """Release the port; harmless when repeated. Closing does not start or stop any motion."""


@dataclass(frozen=True)
class LoadFrameState:
    """State of a load frame, read in one coherent block at `time_s` of the rig's clock.

    Attributes
    ----------
    load_n, displacement_mm : float
        Tensile load and crosshead displacement, both positive in tension.
    moving, at_target, holding : bool
        The present motion status of the machine.
    sample : int
        The machine's sample counter. If the counter does not increase, the values are stale.
    faults : tuple of str
        Names of active faults, trips and limits; empty without any.
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
        """Begin to approach a load. Loads beyond the limits are refused."""

    def go_to_displacement(self, displacement_mm: float, speed_mm_s: float) -> None:
        """Begin to approach a crosshead position. Positions beyond the limits are refused."""

    def hold(self) -> None:
        """Stop and hold position before any waiting command, and wait until the machine confirms."""

    def tare(self) -> None:
        """Make the present load and displacement the zero."""

    def close(self) -> None:
        """Release the link; harmless when repeated. Closing does not start or stop any motion."""


class OperatorAction(Enum):
    """An action that a protocol requests from the person at the rig."""

    ATTACH_GRID = "attach the calibration grid to the specimen"
    REMOVE_GRID = "remove the calibration grid"


class Operator(Protocol):
    """The person at the rig, or a substitute for that person."""

    def perform(self, action: OperatorAction) -> None:
        """Return after the action was done; raise `DeviceError` if the person refused the action."""


@dataclass(frozen=True)
class OpenContext:
    """Arguments of a driver other than its settings.

    Attributes
    ----------
    name : str
        The device's name in the rig file, for messages.
    clock : Clock
    environment : object or None
        The simulated rig, if there is one. `clock` is its clock; `addresses` holds the ports of its servers
        by name, and a rig file refers to them as ``@name``. Simulated devices know the concrete type.
    """

    name: str
    clock: Clock
    environment: Any = None
