"""The crosshead of a load frame and its controller, simulated in steps of one control period."""

from enum import Enum
from math import copysign
from typing import Protocol

from simulators.load_frame.drive import Drive, DriveSettings
from simulators.load_frame.load_cell import Lie, LoadCell
from simulators.load_frame.state import FaultCode, MachineLimits

CONTROL_PERIOD_S = 0.02
LOAD_TOLERANCE_N = 1.0
TRAVEL_TOLERANCE_MM = 1e-4
_ROUNDING = 1e-9
# The stiffness that the load controller assumes before the first motion. The controller never assumes a lower
# stiffness later, because the crosshead would then jump when a slack specimen becomes tight.
STIFFNESS_GUESS_N_MM = 10_000.0
STIFFNESS_MIN_N_MM = 1_000.0


class LoadString(Protocol):
    """Interface of specimen, grips and load frame in series.

    The load depends on earlier plastic deformation.
    """

    def stretch_to(self, displacement_mm: float) -> float:
        """Move the crosshead to `displacement_mm`, counted from the test's start; return the load in N."""

    def break_now(self) -> None:
        """Break the specimen; the load stays at zero from now on."""


class ControlMode(Enum):
    """The control mode of the crosshead: hold the position, or follow a displacement or a load."""

    HOLD = "hold"
    DISPLACEMENT = "displacement"
    LOAD = "load"


class Crosshead:
    """A crosshead that holds its position, or follows a position or a load.

    Parameters
    ----------
    load_string : LoadString

    Attributes
    ----------
    control : ControlMode
    target : float
        The target in mm or N, relative to the zero set by `tare`.
    at_target : bool
        True if the crosshead has reached the target and stands still.
    speed_mm_s : float
        The speed in the last control period.
    set_mm_s : float
        The speed of the motion to a displacement that the controller says it follows.
    jammed : bool
        True if the crosshead is mechanically blocked.
    cell : LoadCell
        The load cell, which the controller and the machine's limits use.
    drive : Drive
        The drive, which limits the acceleration in displacement control.
    """

    def __init__(self, load_string: LoadString) -> None:
        self.jammed = False
        self.cell = LoadCell()
        self.drive = Drive(DriveSettings(), CONTROL_PERIOD_S)
        self._string = load_string
        self._time_s = 0.0
        self._position_mm = 0.0
        self._force_n = load_string.stretch_to(0.0)
        self.reset()

    def reset(self) -> None:
        """Stop the crosshead, and reset the target, the zeros and the measured stiffness."""
        self._zero_mm = 0.0
        self._zero_n = 0.0
        self.cell.reset()
        self._stiffness_n_mm = STIFFNESS_GUESS_N_MM
        self._rate = self.set_mm_s = 0.0
        self._setpoint_n = 0.0
        self.target = 0.0
        self.stand(ControlMode.HOLD)

    @property
    def load_n(self) -> float:
        """The real load in N, relative to the zero set by `tare`."""
        return self._force_n - self._zero_n

    @property
    def shown_n(self) -> float:
        """The load that the load cell shows, in N, without noise."""
        return self.cell.load_n(self._force_n, self._time_s)

    def lie(self, lie: Lie, drift_n_s: float = 0.0) -> None:
        """Make the load cell show a wrong load; with `Lie.NONE` the cell shows the real load again."""
        self.cell.begin(lie, self._force_n, self._time_s, drift_n_s)

    def wait_until(self, time_s: float) -> None:
        """Set the machine's time in s; the reading of a drifting load cell depends on this time."""
        self._time_s = time_s

    @property
    def displacement_mm(self) -> float:
        """The real position of the crosshead in mm, relative to the zero set by `tare`."""
        return self._position_mm - self._zero_mm

    @property
    def moving(self) -> bool:
        """True if the crosshead follows a target and has not reached it yet, or brakes."""
        if self.control is ControlMode.HOLD:
            return self.speed_mm_s != 0.0
        return not self.at_target

    def begin(self, control: ControlMode, target: float, rate: float) -> None:
        """Begin to approach a target in mm or N, with a rate in mm/s or N/s."""
        self.control, self.target, self._rate = control, target, rate
        self.set_mm_s = rate if control is ControlMode.DISPLACEMENT else 0.0
        self.at_target = False
        self._setpoint_n = self.shown_n

    def change_speed(self, speed_mm_s: float, said_mm_s: float) -> None:
        """Go on to the target in mm at another speed. The controller reports the speed `said_mm_s`."""
        self._rate, self.set_mm_s = speed_mm_s, said_mm_s

    @property
    def rate_mm_s(self) -> float:
        """The speed at which the crosshead really approaches a target in mm."""
        return self._rate

    def hold(self) -> None:
        """Brake, and then hold the position."""
        if self.drive.braked(self.speed_mm_s) == 0.0:
            self.stand(ControlMode.HOLD)
        else:
            self.control, self.at_target, self.set_mm_s = ControlMode.HOLD, False, 0.0

    def stand(self, control: ControlMode, *, at_target: bool = False) -> None:
        """Stop the crosshead. The new control mode is `HOLD`, or the mode in which the target was reached."""
        self.control = control
        self.at_target = at_target
        self.speed_mm_s = self.set_mm_s = 0.0

    def tare(self) -> None:
        """Set the zeros to the current load and position, and hold the position."""
        self._zero_n, self._zero_mm = self._force_n, self._position_mm
        self.cell.tare(self._force_n, self._time_s)
        self.stand(ControlMode.HOLD)

    def break_string(self) -> None:
        """Break the specimen in the grips."""
        self._string.break_now()
        self._force_n = self._string.stretch_to(self._position_mm)

    def follow(self, limits: MachineLimits, ratings: MachineLimits) -> FaultCode:
        """Move the crosshead for one control period, and return the fault that occurred in this period.

        `limits` are relative to the zero set by `tare`. `ratings` are relative to the machine's own zero.
        """
        if self.jammed:
            return FaultCode.STALL
        step_mm, arrives = self._next_step(limits)
        self._step(step_mm)
        out = step_mm > 0
        fault = _beyond(limits, self.shown_n, self.displacement_mm, out) or _beyond(
            ratings, self._force_n, self._position_mm, out
        )
        if fault:
            return fault
        if self.control is ControlMode.LOAD:
            error_n = self.target - self.shown_n
            arrives = self._setpoint_n == self.target and abs(error_n) <= LOAD_TOLERANCE_N
        if arrives:
            self.stand(self.control, at_target=self.control is not ControlMode.HOLD)
        return FaultCode.NONE

    def _next_step(self, limits: MachineLimits) -> tuple[float, bool]:
        """Return the way in the next control period, and whether the crosshead then stands."""
        if self.control is ControlMode.LOAD:
            ramp_n = self._rate * CONTROL_PERIOD_S
            self._setpoint_n += min(max(self.target - self._setpoint_n, -ramp_n), ramp_n)
            wanted_mm = (self._setpoint_n - self.shown_n) / self._stiffness_n_mm
            reach_mm = limits.speed_max_mm_s * CONTROL_PERIOD_S
            return min(max(wanted_mm, -reach_mm), reach_mm), False
        if self.control is ControlMode.HOLD:
            speed_mm_s = self.drive.braked(self.speed_mm_s)
            return speed_mm_s * CONTROL_PERIOD_S, speed_mm_s == 0.0
        wanted_mm = self.target - self.displacement_mm
        towards_mm_s = copysign(self.drive.approach_mm_s(abs(wanted_mm), self._rate), wanted_mm)
        speed_mm_s = self.drive.next_speed(self.speed_mm_s, towards_mm_s)
        step_mm = speed_mm_s * CONTROL_PERIOD_S
        reaches = step_mm * wanted_mm >= 0.0 and abs(step_mm) >= abs(wanted_mm)
        # A faster crosshead cannot stop in one period. It passes a target that is too near, and comes back.
        if reaches and abs(speed_mm_s) <= self.drive.step_mm_s * (1.0 + _ROUNDING):
            return wanted_mm, True
        return step_mm, False

    def _step(self, step_mm: float) -> None:
        before_n = self.shown_n
        self._position_mm += step_mm
        self._force_n = self._string.stretch_to(self._position_mm)
        self.speed_mm_s = step_mm / CONTROL_PERIOD_S
        if step_mm:
            self._stiffness_n_mm = max((self.shown_n - before_n) / step_mm, STIFFNESS_MIN_N_MM)


def _beyond(limits: MachineLimits, load_n: float, displacement_mm: float, out: bool) -> FaultCode:
    """Return a fault if the crosshead moved outwards beyond a limit.

    Motion back towards the allowed range is never a fault.
    """
    if out:
        overload = load_n > limits.load_max_n + LOAD_TOLERANCE_N
        overtravel = displacement_mm > limits.displacement_max_mm + TRAVEL_TOLERANCE_MM
    else:
        overload = load_n < limits.load_min_n - LOAD_TOLERANCE_N
        overtravel = displacement_mm < limits.displacement_min_mm - TRAVEL_TOLERANCE_MM
    if overload:
        return FaultCode.LOAD_LIMIT
    return FaultCode.DISPLACEMENT_LIMIT if overtravel else FaultCode.NONE
