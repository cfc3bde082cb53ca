"""Limits, readings, faults and refusals of a load frame."""

from dataclasses import dataclass
from enum import IntEnum

from drivers.interfaces import LoadFrameLimits


class FaultCode(IntEnum):
    """The reason why the machine stopped without a command."""

    NONE = 0
    WATCHDOG = 1
    LOAD_LIMIT = 2
    DISPLACEMENT_LIMIT = 3
    ESTOP = 4
    STALL = 5


class Refusal(IntEnum):
    """The reason why the machine refuses a command."""

    BEYOND_LIMITS = 1
    TOO_FAST = 2
    NOT_READY = 3
    UNKNOWN = 4
    NO_MOTION = 5


class RefusedError(Exception):
    """The machine refused a command."""

    def __init__(self, reason: Refusal) -> None:
        self.reason = reason
        super().__init__(reason.name)


@dataclass(frozen=True)
class MachineLimits(LoadFrameLimits):
    """Limits of load, displacement, speed and load rate, in N, mm and s."""

    def encloses(self, other: "MachineLimits") -> bool:
        """Return True if the limits `other` lie within these limits, and no range of `other` is empty."""
        return (
            self.load_min_n <= other.load_min_n < other.load_max_n <= self.load_max_n
            and self.displacement_min_mm <= other.displacement_min_mm
            and other.displacement_min_mm < other.displacement_max_mm <= self.displacement_max_mm
            and 0 < other.speed_max_mm_s <= self.speed_max_mm_s
            and 0 < other.load_rate_max_n_s <= self.load_rate_max_n_s
        )


@dataclass(frozen=True)
class FrameReadings:
    """The readings of a load frame in one control period.

    `speed_mm_s` is the crosshead's speed, negative inwards. `set_speed_mm_s` is the speed to which the
    present motion to a displacement is set, or 0.
    """

    sample: int
    time_s: float
    moving: bool
    at_target: bool
    holding: bool
    fault: FaultCode
    estop: bool
    load_n: float
    displacement_mm: float
    speed_mm_s: float
    set_speed_mm_s: float
    target: float
