"""The crosshead of a load frame and its servo, advanced by one control period at a time."""

from enum import Enum
from typing import Protocol

from simulators.load_frame.state import FaultCode, MachineLimits

CONTROL_PERIOD_S = 0.02
LOAD_TOLERANCE_N = 1.0
TRAVEL_TOLERANCE_MM = 1e-4
# The stiffness that the load controller assumes before it has seen the specimen respond, and its lower bound:
# too soft a belief makes the crosshead jump when a slack string tightens.
STIFFNESS_GUESS_N_MM = 10_000.0
STIFFNESS_MIN_N_MM = 1_000.0


class LoadString(Protocol):
    """Specimen, grips and load frame in series; it remembers plastic deformation."""

    def stretch_to(self, displacement_mm: float) -> float:
        """Bring the crosshead to `displacement_mm` from the start of the test and return the load in N."""

    def break_now(self) -> None:
        """Break; no load is carried from now on."""


class Control(Enum):
    """What the crosshead follows."""

    HOLD = "hold"
    DISPLACEMENT = "displacement"
    LOAD = "load"


class Crosshead:
    """A crosshead that follows a position or a load, or stands.

    Parameters
    ----------
    load_string : LoadString

    Attributes
    ----------
    control : Control
    target : float
        In mm or N, from the zero.
    at_target : bool
        Whether the crosshead reached the target and stands still.
    speed_mm_s : float
        Of the last period.
    jammed : bool
        Whether something blocks it.
    """

    def __init__(self, load_string: LoadString) -> None:
        self.jammed = False
        self._string = load_string
        self._position_mm = 0.0
        self._force_n = load_string.stretch_to(0.0)
        self.reset()

    def reset(self) -> None:
        """Stop here, and forget targets, zeros and the measured stiffness of the string."""
        self._zero_mm = 0.0
        self._zero_n = 0.0
        self._stiffness_n_mm = STIFFNESS_GUESS_N_MM
        self._rate = 0.0
        self._setpoint_n = 0.0
        self.target = 0.0
        self.stand(Control.HOLD)

    @property
    def load_n(self) -> float:
        """True load in the string, from the zero set by `tare`."""
        return self._force_n - self._zero_n

    @property
    def displacement_mm(self) -> float:
        """True position, from the zero set by `tare`."""
        return self._position_mm - self._zero_mm

    @property
    def moving(self) -> bool:
        """Whether the crosshead has not reached its target yet."""
        return self.control is not Control.HOLD and not self.at_target

    def begin(self, control: Control, target: float, rate: float) -> None:
        """Begin to follow a target, at mm/s or N/s."""
        self.control, self.target, self._rate = control, target, rate
        self.at_target = False
        self._setpoint_n = self.load_n

    def stand(self, control: Control, *, at_target: bool = False) -> None:
        """Stop; `control` goes on if it is not HOLD."""
        self.control = control
        self.at_target = at_target
        self.speed_mm_s = 0.0

    def tare(self) -> None:
        """Make the present load and position the zero, and hold."""
        self._zero_n, self._zero_mm = self._force_n, self._position_mm
        self.stand(Control.HOLD)

    def break_string(self) -> None:
        """Break what is in the grips."""
        self._string.break_now()
        self._force_n = self._string.stretch_to(self._position_mm)

    def follow(self, limits: MachineLimits, ratings: MachineLimits) -> FaultCode:
        """Advance by one control period, and return what went wrong in it.

        MachineLimits are measured from the zero set by `tare`; the machine's ratings from its own zero.
        """
        if self.jammed:
            return FaultCode.STALL
        if self.control is Control.DISPLACEMENT:
            wanted_mm = self.target - self.displacement_mm
            speed_mm_s = self._rate
        else:
            ramp_n = self._rate * CONTROL_PERIOD_S
            self._setpoint_n += min(max(self.target - self._setpoint_n, -ramp_n), ramp_n)
            wanted_mm = (self._setpoint_n - self.load_n) / self._stiffness_n_mm
            speed_mm_s = limits.speed_max_mm_s
        reach_mm = speed_mm_s * CONTROL_PERIOD_S
        step_mm = min(max(wanted_mm, -reach_mm), reach_mm)
        self._step(step_mm)
        out = step_mm > 0
        fault = _beyond(limits, self.load_n, self.displacement_mm, out) or _beyond(
            ratings, self._force_n, self._position_mm, out
        )
        if fault:
            return fault
        if self.control is Control.DISPLACEMENT:
            arrived = step_mm == wanted_mm
        else:
            error_n = self.target - self.load_n
            arrived = self._setpoint_n == self.target and abs(error_n) <= LOAD_TOLERANCE_N
        if arrived:
            self.stand(self.control, at_target=True)
        return FaultCode.NONE

    def _step(self, step_mm: float) -> None:
        before_n = self._force_n
        self._position_mm += step_mm
        self._force_n = self._string.stretch_to(self._position_mm)
        self.speed_mm_s = step_mm / CONTROL_PERIOD_S
        if step_mm:
            self._stiffness_n_mm = max((self._force_n - before_n) / step_mm, STIFFNESS_MIN_N_MM)


def _beyond(limits: MachineLimits, load_n: float, displacement_mm: float, out: bool) -> FaultCode:
    """Whether the motion passed a limit outwards; moving back inwards is always allowed."""
    if out:
        overload = load_n > limits.load_max_n + LOAD_TOLERANCE_N
        overtravel = displacement_mm > limits.displacement_max_mm + TRAVEL_TOLERANCE_MM
    else:
        overload = load_n < limits.load_min_n - LOAD_TOLERANCE_N
        overtravel = displacement_mm < limits.displacement_min_mm - TRAVEL_TOLERANCE_MM
    if overload:
        return FaultCode.LOAD_LIMIT
    return FaultCode.DISPLACEMENT_LIMIT if overtravel else FaultCode.NONE
