"""Interfaces between the control program of a test rig and the devices.

Every driver, for a real or a simulated device, implements one of the protocol classes in this module. Drivers
of third parties are found by entry point (`drivers.registry`). Every call to a device returns within a
limited time or raises a `DeviceError`. Only `Operator.perform` may wait for a person without a deadline. A
caller that waits for the end of a motion must set a deadline itself.
"""

import math
from dataclasses import dataclass
from datetime import datetime
from enum import Enum
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from drivers.clock import Clock


@dataclass(frozen=True)
class DeviceInfo:
    """Identity of a device, as the device reports it. The identity is written into the run file."""

    vendor: str
    model: str
    serial: str
    firmware: str = ""
    simulated: bool = False


@dataclass(frozen=True)
class CameraInfo(DeviceInfo):
    """Identity and picture format of a camera. `bits` is the number of significant bits per pixel."""

    width_px: int = 0
    height_px: int = 0
    bits: int = 8


@dataclass(frozen=True)
class Frame:
    """One camera image, neither filtered nor corrected, with its times and camera settings.

    Attributes
    ----------
    image : ndarray of uint8 or uint16, shape (height, width)
    exposed_s : float
        Earliest possible start of the exposure, in seconds on the rig's monotonic clock. If the delay between
        exposure and timestamp is unknown, the driver subtracts the longest possible delay.
    received_s : float
        Time at which the program received the frame, in seconds on the rig's monotonic clock.
    utc : datetime
        Date and time (UTC) of the start of exposure `exposed_s`.
    sequence : int
        Number of the frame, from the camera's counter. A gap in the numbers means lost frames.
    flags : int
        Error flags that the driver sets for a damaged frame. A good frame has 0.
    exposure_us, gain : float
        Exposure time in µs and gain in the camera's unit, or NaN if unknown.
    middle_s, middle_std_s : float
        Best estimate of the middle of the exposure, in seconds on the rig's clock, and its standard
        deviation. NaN if the driver knows no better than `exposed_s`, `received_s` and `exposure_us` tell.
    """

    image: NDArray[np.uint8] | NDArray[np.uint16]
    exposed_s: float
    received_s: float
    utc: datetime
    sequence: int
    flags: int
    exposure_us: float
    gain: float
    middle_s: float = math.nan
    middle_std_s: float = math.nan

    @property
    def middle(self) -> tuple[float, float]:
        """The middle of the exposure in s on the rig's clock, and its standard deviation in s.

        Without an estimate by the driver, the exposure began somewhere between `exposed_s` and the last
        moment at which it could still end before `received_s`. If its length is unknown, it may have been
        anything up to that time.
        """
        if not math.isnan(self.middle_s):
            return self.middle_s, self.middle_std_s
        length_s = 0.0 if math.isnan(self.exposure_us) else 1e-6 * self.exposure_us
        spread_s = max(0.0, self.received_s - self.exposed_s - length_s)
        # a uniform distribution
        return self.exposed_s + (length_s + spread_s) / 2, spread_s / math.sqrt(12.0)


class Camera(Protocol):
    """Interface of a camera. `grab` returns only frames whose exposure began after the call."""

    info: CameraInfo

    def grab(self, timeout_s: float) -> Frame:
        """Return a frame whose exposure began after this call. Raise `DeviceTimeout` after `timeout_s`."""

    def close(self) -> None:
        """Release the camera. A repeated call has no effect."""


@dataclass(frozen=True)
class StageState:
    """Position and status of a rotation stage.

    `warnings` are the warning flags that the stage reports. `time_s` is the time at which the state was read
    from the stage, in seconds on the rig's clock.
    """

    angle_deg: float
    moving: bool
    homed: bool
    warnings: tuple[str, ...]
    time_s: float


class RotationStage(Protocol):
    """A motorised rotation stage with one axis. A positive angle turns the X axis towards the Y axis."""

    info: DeviceInfo

    def read(self) -> StageState:
        """Return position and status. Raise `DeviceFault` if the stage reports that a motion failed."""

    def home(self) -> None:
        """Start the search for the reference position. `read` shows when the search has ended."""

    def move_to(self, angle_deg: float) -> None:
        """Start a move to an absolute angle.

        Raise `DeviceFault` if the angle is beyond the limits, or if the stage has no reference position.
        """

    def stop(self) -> None:
        """Send a stop command ahead of all waiting commands, and wait until the stage reports standstill."""

    def close(self) -> None:
        """Release the port, without starting or stopping any motion. A repeated call has no effect."""


@dataclass(frozen=True)
class LoadFrameState:
    """State of a load frame. All values belong to one reading at `time_s`, in seconds on the rig's clock.

    Attributes
    ----------
    load_n, displacement_mm : float
        Tensile load in N and crosshead displacement in mm, which are both positive in tension.
    moving, at_target, holding : bool
        True if the machine is moving, has reached its target, or is holding its position.
    sample : int
        The machine's sample counter. If the counter does not increase, the values are stale.
    faults : tuple of str
        Names of the active faults, trips and limits. The tuple is empty if none is active.
    speed_mm_s : float
        Speed in mm/s, without a sign, to which the machine says its present motion to a displacement is set.
        NaN if the machine does not report this speed.
    """

    load_n: float
    displacement_mm: float
    moving: bool
    at_target: bool
    holding: bool
    sample: int
    faults: tuple[str, ...]
    time_s: float
    speed_mm_s: float = math.nan


@dataclass(frozen=True)
class LoadFrameLimits:
    """Limits of load, displacement, speed and load rate, as read back from the load frame.

    A load frame that cannot control the load, but only the displacement, has a `load_rate_max_n_s` of 0.
    """

    load_min_n: float
    load_max_n: float
    displacement_min_mm: float
    displacement_max_mm: float
    speed_max_mm_s: float
    load_rate_max_n_s: float


class LoadFrame(Protocol):
    """A tensile load frame in displacement control and, mostly, in load control.

    In its safe state it holds its position.
    """

    info: DeviceInfo
    limits: LoadFrameLimits

    def read(self) -> LoadFrameState:
        """Read the machine's state and reset its watchdog. Raise `DeviceError` if the values are invalid."""

    def go_to_load(self, load_n: float, rate_n_s: float) -> None:
        """Start a ramp to a load, in N, at a rate in N/s. Loads beyond the limits are refused.

        A load frame without control of the load refuses every load with a `DeviceFault`.
        """

    def go_to_displacement(self, displacement_mm: float, speed_mm_s: float) -> None:
        """Start a move to a crosshead position, in mm. Positions beyond the limits are refused."""

    def hold(self) -> None:
        """Send a hold command ahead of all waiting commands, and wait until the machine confirms the hold."""

    def tare(self) -> None:
        """Set the zero points of load and displacement to the present state."""

    def close(self) -> None:
        """Release the link, without starting or stopping any motion. A repeated call has no effect."""


class ChangesSpeed(Protocol):
    """Optional part of the interface of a load frame: another speed during a motion to a displacement.

    A test at a strain rate needs it. A load frame without the method keeps the speed of each motion. If the
    settings of the driver have an attribute `changes_speed`, which is True or False, the plan of a run knows
    this without opening the load frame.
    """

    def change_speed(self, speed_mm_s: float) -> None:
        """Go on to the same target at another speed, in mm/s, without a stop.

        The method returns when the machine has confirmed the new speed, which `LoadFrameState.speed_mm_s`
        then reports. Raise `DeviceFault` for a speed of 0, a negative speed or one beyond
        `LoadFrameLimits.speed_max_mm_s`, and if no motion to a displacement is going on. The method never
        starts a motion: a hold that is requested later, or that was requested since the motion began, is the
        last word, in whatever order the messages arrive.
        """


@dataclass(frozen=True)
class InterlockState:
    """Reading of an interlock: its value, and the time of the reading in seconds on the rig's clock.

    The value of a contact is 1 if the contact is closed, and 0 if it is open.
    """

    value: float
    time_s: float


class Interlock(Protocol):
    """Interface of an interlock, such as a door contact.

    A run starts and continues only while the value of the interlock is within its bounds.

    Attributes
    ----------
    unit : str
        Unit of the value, or an empty text for a contact.
    """

    info: DeviceInfo
    unit: str

    def read(self) -> InterlockState:
        """Return the present value. Raise `DeviceError` if there is no valid value."""

    def close(self) -> None:
        """Release the link. A repeated call has no effect."""


Setting: TypeAlias = str | float | int | bool
"""Value of a setting that a device reports."""


class ReadsSettings(Protocol):
    """Optional part of the interface of a camera, a stage, a load frame or an interlock: its settings.

    The settings are written into the run file before the first image and at the end of the run, so that the
    run file says how the device was really set. A driver without the method reports no settings.
    """

    def read_settings(self) -> dict[str, Setting]:
        """Read the present settings back from the device, without a motion. Raise `DeviceError` on failure.

        The method returns settings only, and no readings such as a temperature. So two calls in a row return
        the same values. A name has lower-case letters, digits and underscores, and ends with the unit of a
        number, as in ``exposure_us``. The method ends within two seconds.
        """


class OperatorAction(Enum):
    """An action that a test protocol requests from the person at the rig."""

    ATTACH_GRID = "attach the calibration grid to the specimen"
    REMOVE_GRID = "remove the calibration grid"
    GO_ON = (
        "make sure that nobody touched or moved the loaded specimen since the earlier run ended, and that "
        "the test may go on with it"
    )


@dataclass(frozen=True)
class OperatorQuestion:
    """A request of a protocol to the person at the rig, in one line, and the word that confirms it."""

    text: str
    word: str

    def is_confirmed_by(self, typed: str) -> bool:
        """Return True if a typed text is the word. Capital letters and spaces around it do not matter."""
        return typed.strip().casefold() == self.word.casefold()


class Operator(Protocol):
    """The person at the rig, or a substitute for that person.

    An operator may also have a method ``notice(action)``, which returns a sentence about the action, for
    example how long a simulated operator takes. An operator without the method ``notice`` asks a real person.

    An operator may also have a method ``close()``, which ends a waiting `perform` with a `DeviceError`. A run
    that ends while it waits for the operator calls this method.

    An operator who can be asked the questions of a protocol also has the methods of `AsksQuestions`.
    """

    def perform(self, action: OperatorAction) -> None:
        """Wait until the person has done the action. Raise `DeviceError` if the person refuses the action."""


class AsksQuestions(Protocol):
    """Optional part of the interface of an operator: questions with a word that the protocol declares.

    A run with a phase `ask` needs these methods. Its questions are also given to ``notice``, if there is one.
    """

    def ask(self, question: OperatorQuestion) -> None:
        """Wait until the person has confirmed a question with its word. Raise `DeviceError` on a refusal."""

    def withdraw(self) -> None:
        """End a waiting `ask`, because the question was answered elsewhere. Later questions are asked."""


@dataclass(frozen=True)
class OpenContext:
    """Values that a driver receives in addition to its settings.

    Attributes
    ----------
    name : str
        The device's name in the rig file. Error messages contain this name.
    clock : Clock
        The clock of the run. In a simulated rig it is the simulated clock.
    environment : object or None
        The simulated rig, or None for a real rig. The attribute `addresses` of a simulated rig maps the name
        of each simulated server to an address. A rig file refers to such an address as ``@name``. Drivers of
        simulated devices also use other attributes of the simulated rig. The attribute `patience_s`, if there
        is one, becomes `patience_s` of this class.
    guarded : bool
        True if a guardian process watches the run and has a connection to the device. The guardian stops the
        device if the process of the run fails.
    relay : str
        Address ``host:port`` on this computer at which the guardian passes messages to the device. The
        address is empty if the driver has its own connection. If no guardian answers at the address any more,
        the driver opens the line itself.
    call_timeout_s : float
        Deadline of the rig for one call of the device, in seconds; infinite outside a rig. The driver reports
        a missing answer itself before this deadline.
    patience_s : float
        Additional real time, in seconds, for each call, and for each answer while the device is opened; 0 for
        a real device. A simulated device may answer late because other programs keep the computer busy.
        Simulated time stands still while the program waits for such an answer.
    """

    name: str
    clock: Clock
    environment: Any = None
    guarded: bool = False
    relay: str = ""
    call_timeout_s: float = math.inf
    patience_s: float = 0.0
