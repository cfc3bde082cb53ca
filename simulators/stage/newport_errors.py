"""The error queue of a Newport ESP301.

Source: ESP301 Integrated 3-Axis Motion Controller/Driver, User's Manual, appendix Error Messages. Error codes
from 100 belong to an axis: code 106 is error 6 of axis 1.
"""

from collections import deque
from collections.abc import Callable

from simulators.stage.device import StageDevice

NO_ERROR = 0
EMERGENCY_STOP, UNKNOWN_COMMAND, OUT_OF_RANGE, NO_SUCH_AXIS, NO_AXIS, NO_PARAMETER = 4, 6, 7, 9, 37, 38
AXIS = 100
(
    AXIS_OUT_OF_RANGE,
    FOLLOWING_ERROR,
    HARD_LIMIT,
    SOFT_LIMIT_MAX,
    SOFT_LIMIT_MIN,
    NOT_CONNECTED,
    TOO_FAST,
    TOO_SUDDEN,
    MOTOR_OFF,
) = (1, 3, 4, 6, 7, 8, 10, 11, 13)

_TEXTS = {
    NO_ERROR: "NO ERROR DETECTED",
    EMERGENCY_STOP: "EMERGENCY STOP ACTIVATED",
    UNKNOWN_COMMAND: "COMMAND DOES NOT EXIST",
    OUT_OF_RANGE: "PARAMETER OUT OF RANGE",
    NO_SUCH_AXIS: "AXIS NUMBER OUT OF RANGE",
    NO_AXIS: "AXIS NUMBER MISSING",
    NO_PARAMETER: "COMMAND PARAMETER MISSING",
}
_AXIS_TEXTS = {
    AXIS_OUT_OF_RANGE: "PARAMETER OUT OF RANGE",
    FOLLOWING_ERROR: "FOLLOWING ERROR THRESHOLD EXCEEDED",
    HARD_LIMIT: "POSITIVE HARDWARE LIMIT DETECTED",
    5: "NEGATIVE HARDWARE LIMIT DETECTED",
    SOFT_LIMIT_MAX: "POSITIVE SOFTWARE LIMIT DETECTED",
    SOFT_LIMIT_MIN: "NEGATIVE SOFTWARE LIMIT DETECTED",
    NOT_CONNECTED: "MOTOR / STAGE NOT CONNECTED",
    TOO_FAST: "MAXIMUM VELOCITY EXCEEDED",
    TOO_SUDDEN: "MAXIMUM ACCELERATION EXCEEDED",
    MOTOR_OFF: "MOTOR NOT ENABLED",
    15: "MAXIMUM JERK EXCEEDED",
    20: "HOMING ABORTED",
}
SERVO_CYCLE_S = 0.0004
QUEUE_MAX = 10

# The error code of this controller for each flag of the stage, and True if the motor loses power.
_FLAGS = {
    "FS": (AXIS + FOLLOWING_ERROR, True),
    "FE": (AXIS + HARD_LIMIT, False),
    "FH": (EMERGENCY_STOP, True),
}


class NewportError(Exception):
    """A command was not executed. The error code is added to the error queue."""

    def __init__(self, code: int) -> None:
        self.code = code
        super().__init__(text_of(code))


def text_of(code: int) -> str:
    """Return the message of an error code."""
    axis, number = divmod(code, AXIS)
    if not axis:
        return _TEXTS.get(code, "ERROR")
    return f"AXIS-{axis} {_AXIS_TEXTS.get(number, 'ERROR')}"


class ErrorQueue:
    """The controller's errors in the order of their occurrence. Each query removes the oldest error.

    ``now_s()`` returns the time in s since the controller was switched on.
    """

    def __init__(self, now_s: Callable[[], float]) -> None:
        self._now_s = now_s
        self._errors: deque[tuple[int, float]] = deque(maxlen=QUEUE_MAX)
        self._flags: set[str] = set()

    def add(self, code: int) -> None:
        """Add an error to the end of the queue."""
        self._errors.append((code, self._now_s()))

    def take(self) -> tuple[int, int, str]:
        """Remove the oldest error and return its code, its time in servo cycles and its text."""
        code, time_s = self._errors.popleft() if self._errors else (NO_ERROR, self._now_s())
        return code, int(time_s / SERVO_CYCLE_S), text_of(code)

    def watch(self, device: StageDevice) -> bool:
        """Add errors for the stage's faults since the last call; return True if the motor lost power."""
        flags = set(device.flags)
        fresh, self._flags = flags - self._flags, flags
        happened = [_FLAGS[flag] for flag in sorted(fresh) if flag in _FLAGS]
        for code, _ in happened:
            self.add(code)
        return any(cuts for _, cuts in happened)
