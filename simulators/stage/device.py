"""The mechanics of a rotation stage: shaft, position counter, warning flags and limits.

This module contains no protocol. The modules `simulators.stage.zaber` and `simulators.stage.newport` connect
a stage to a line.
"""

import threading
from collections.abc import Iterable
from dataclasses import dataclass

from drivers.clock import Clock

# Flags that end a motion, and forbid the next motion until the motor driver is switched on again.
DISABLING_FLAGS = ("FD", "FO", "FH", "FV")
HOMING_BACKOFF_DEG = 2.0


class StageRefusedError(Exception):
    """The stage refuses a command. The text is the reason in Zaber's protocol, such as ``BADDATA``."""


@dataclass(frozen=True)
class Segment:
    """A part of a motion with constant acceleration, in degrees and seconds."""

    start_s: float
    duration_s: float
    angle_deg: float
    speed_deg_s: float
    acceleration_deg_s2: float

    @property
    def end_s(self) -> float:
        """The time at which the segment ends."""
        return self.start_s + self.duration_s

    def angle_at(self, time_s: float) -> float:
        """Return the shaft angle at a time; for a time outside the segment, the angle at its nearer end."""
        t = min(max(time_s - self.start_s, 0.0), self.duration_s)
        return self.angle_deg + self.speed_deg_s * t + self.acceleration_deg_s2 * t * t / 2

    def speed_at(self, time_s: float) -> float:
        """Return the shaft speed at a time; for a time outside the segment, the speed at its nearer end."""
        t = min(max(time_s - self.start_s, 0.0), self.duration_s)
        return self.speed_deg_s + self.acceleration_deg_s2 * t


def _chain(time_s: float, angle_deg: float, parts: Iterable[tuple[float, float, float]]) -> list[Segment]:
    segments: list[Segment] = []
    for duration_s, speed_deg_s, acceleration_deg_s2 in parts:
        segment = Segment(time_s, duration_s, angle_deg, speed_deg_s, acceleration_deg_s2)
        segments.append(segment)
        time_s, angle_deg = segment.end_s, segment.angle_at(segment.end_s)
    return segments


def braking(time_s: float, angle_deg: float, speed_deg_s: float, deceleration_deg_s2: float) -> list[Segment]:
    """Return the motion that brakes the shaft from `speed_deg_s` to a standstill."""
    deceleration = -deceleration_deg_s2 if speed_deg_s > 0 else deceleration_deg_s2
    return _chain(time_s, angle_deg, [(abs(speed_deg_s) / deceleration_deg_s2, speed_deg_s, deceleration)])


def trapezoid(
    time_s: float, start_deg: float, end_deg: float, speed_deg_s: float, acceleration_deg_s2: float
) -> list[Segment]:
    """Return the motion from rest to rest: accelerate, move at constant speed, brake.

    A short motion does not reach the full speed.
    """
    distance = end_deg - start_deg
    sign = 1.0 if distance >= 0 else -1.0
    peak = min(speed_deg_s, (abs(distance) * acceleration_deg_s2) ** 0.5)
    ramp_s = peak / acceleration_deg_s2
    cruise_s = (abs(distance) - peak * ramp_s) / peak if peak else 0.0
    return _chain(
        time_s,
        start_deg,
        [
            (ramp_s, 0.0, sign * acceleration_deg_s2),
            (cruise_s, sign * peak, 0.0),
            (ramp_s, sign * peak, -sign * acceleration_deg_s2),
        ],
    )


class StageDevice:
    """A motorised rotary stage with an index mark at shaft angle 0.

    Parameters
    ----------
    clock : Clock
        The clock of the simulated motion.
    power_up_angle_deg : float
        Angle of the shaft when the stage is switched on. The counter always starts at 0, whatever this angle
        is. The stage has no reference (flag WR) until it is homed.
    microsteps_per_deg : int
    speed_deg_s, acceleration_deg_s2 : float
        The initial values of the settings `maxspeed` and `accel`.
    limit_min_deg, limit_max_deg : float
        The initial values of the settings `limit.min` and `limit.max`. The limits may allow many turns.

    Attributes
    ----------
    executed : list of (float, str)
        Time and name of every started motion, even if the answer to the command was lost.
    power_ups : int
        How often the stage was switched on.
    parked : bool
        True if the stage is parked. A parked stage keeps its position and its reference without power, and
        refuses motion.
    """

    def __init__(
        self,
        clock: Clock,
        *,
        power_up_angle_deg: float = 0.0,
        microsteps_per_deg: int = 6400,
        speed_deg_s: float = 20.0,
        acceleration_deg_s2: float = 200.0,
        limit_min_deg: float = -3600.0,
        limit_max_deg: float = 3600.0,
    ) -> None:
        self.microsteps_per_deg = microsteps_per_deg
        self.speed_microsteps_s = speed_deg_s * microsteps_per_deg
        self.acceleration_microsteps_s2 = acceleration_deg_s2 * microsteps_per_deg
        self.limit_min = round(limit_min_deg * microsteps_per_deg)
        self.limit_max = round(limit_max_deg * microsteps_per_deg)
        self.executed: list[tuple[float, str]] = []
        self._jammed = False
        self.power_ups = 1
        self.parked = False
        self._clock = clock
        self._lock = threading.RLock()
        self._flags = {"WR"}
        self._disabled = False
        self._estop = False
        self._homing = False
        self._offset_deg = power_up_angle_deg
        self._motion = _chain(clock.now_s(), power_up_angle_deg, [(0.0, 0.0, 0.0)])

    def angle_deg(self) -> float:
        """The present real angle of the shaft in degrees; a positive angle turns X towards Y."""
        with self._lock:
            now_s = self._advance()
            return self._segment(now_s).angle_at(now_s)

    @property
    def position(self) -> int:
        """The value of the position counter, in microsteps."""
        with self._lock:
            return round((self.angle_deg() - self._offset_deg) * self.microsteps_per_deg)

    @property
    def speed_deg_s(self) -> float:
        """The present real speed of the shaft, in degrees per second."""
        with self._lock:
            now_s = self._advance()
            return self._segment(now_s).speed_at(now_s) if now_s < self._motion[-1].end_s else 0.0

    @property
    def enabled(self) -> bool:
        """True if the motor driver is on."""
        return not self._disabled

    @property
    def moving(self) -> bool:
        """True until the last commanded motion has ended."""
        with self._lock:
            return self._advance() < self._motion[-1].end_s

    @property
    def flags(self) -> list[str]:
        """Active warning flags, the most severe flags first (F before W before N)."""
        with self._lock:
            self._advance()
            return sorted(self._flags, key=lambda flag: ("FWN".index(flag[0]), flag))

    def _segment(self, now_s: float) -> Segment:
        return next((s for s in self._motion if now_s < s.end_s), self._motion[-1])

    def _advance(self) -> float:
        """Record the end of a home search if it has ended by now, and return the present time."""
        now_s = self._clock.now_s()
        if self._homing and now_s >= self._motion[-1].end_s:
            self._homing = False
            self._offset_deg = 0.0
            self._flags -= {"WR", "WH"}
        return now_s

    def _start(
        self, name: str, plan: list[float], speed: float | None = None, acceleration: float | None = None
    ) -> None:
        """Begin to move to each shaft angle in `plan`, in order; a present motion is braked first."""
        if self._disabled:
            raise StageRefusedError("DRIVERDISABLED")
        if self.parked:
            raise StageRefusedError("PARKED")
        speed = (speed or self.speed_microsteps_s) / self.microsteps_per_deg
        acceleration = (acceleration or self.acceleration_microsteps_s2) / self.microsteps_per_deg
        if self.moving:
            self._flags.add("NI")
            self._homing = False
        now_s = self._advance()
        self.executed.append((now_s, name))
        segment = self._segment(now_s)
        motion = braking(now_s, segment.angle_at(now_s), segment.speed_at(now_s), acceleration)
        for target in plan:
            last = motion[-1]
            motion += trapezoid(last.end_s, last.angle_at(last.end_s), target, speed, acceleration)
        self._motion = motion
        if self._jammed and plan:
            self.fail("FS")

    def home(self) -> None:
        """Begin to search for the index mark; raise `StageRefusedError` if the stage is disabled or parked.

        The shaft moves below the mark first and then up to the mark.
        """
        with self._lock:
            self._start("home", [-HOMING_BACKOFF_DEG, 0.0])
            self._homing = not self._jammed

    def move_to(self, position: int, speed: float | None = None, acceleration: float | None = None) -> None:
        """Begin to move to a counter value.

        `speed` and `acceleration` apply to this motion only. The default values are the stage's settings.
        Raise `StageRefusedError` for a value beyond the limits, and if the stage is disabled or parked.
        """
        with self._lock:
            self._require_within(position)
            angle_deg = position / self.microsteps_per_deg + self._offset_deg
            self._start(f"move {position}", [angle_deg], speed, acceleration)

    def move_by(self, distance: int, speed: float | None = None, acceleration: float | None = None) -> None:
        """Begin to move by a distance in microsteps from the current position."""
        with self._lock:
            self.move_to(self.position + distance, speed, acceleration)

    def turn(self, speed: float, acceleration: float | None = None) -> None:
        """Begin to turn at a speed in microsteps/s until a limit or the next command; 0 stops the shaft."""
        with self._lock:
            if speed == 0:
                self.stop()
                return
            end = self.limit_max if speed > 0 else self.limit_min
            angle_deg = end / self.microsteps_per_deg + self._offset_deg
            self._start(f"turn {speed:g}", [angle_deg], abs(speed), acceleration)

    def park(self) -> None:
        """Park the stage, which keeps its position without power; raise `StageRefusedError` during motion."""
        with self._lock:
            if self.moving:
                raise StageRefusedError("STATUSBUSY")
            self.parked = True

    def set_position(self, position: int) -> None:
        """Give the position counter a new value. The shaft does not move."""
        with self._lock:
            self._offset_deg = self.angle_deg() - position / self.microsteps_per_deg

    def stop(self, acceleration: float | None = None) -> None:
        """Brake to a standstill. If this interrupts a motion, the flag NI is set."""
        with self._lock:
            if self.moving:
                self._start("stop", [], acceleration=acceleration)

    def _require_within(self, position: int) -> None:
        if not self.limit_min <= position <= self.limit_max:
            raise StageRefusedError("BADDATA")

    def clear_flags(self) -> None:
        """Clear the flags of past events; flags for a missing reference or a driver that is off remain."""
        with self._lock:
            self._flags &= {"WR", "WH", *(DISABLING_FLAGS if self._disabled else ())}

    def enable_driver(self) -> None:
        """Switch the motor driver on; raise `StageRefusedError` while the emergency stop is pressed."""
        with self._lock:
            if self._estop:
                raise StageRefusedError("DRIVERDISABLED")
            self._disabled = False
            self._flags -= set(DISABLING_FLAGS)

    def disable_driver(self) -> None:
        """Switch the motor driver off. The current motion ends at once."""
        self.fail("FO")

    def jam(self) -> None:
        """Block the shaft: the present motion and every later motion stop at once with a fault."""
        with self._lock:
            self._jammed = True
            if self.moving:
                self.fail("FS")

    def free(self) -> None:
        """Unblock the shaft."""
        self._jammed = False

    def press_estop(self) -> None:
        """Open the emergency stop chain and switch the motor driver off.

        To switch the driver on again, close the chain and call `enable_driver`.
        """
        self._estop = True
        self.fail("FH")

    def release_estop(self) -> None:
        """Close the emergency stop chain again. The shaft does not move before the next command."""
        self._estop = False

    def fail(self, flag: str) -> None:
        """Stop at once with a fault such as FS (stalled), FH (emergency stop) or FE (limit error)."""
        with self._lock:
            now_s = self._advance()
            self._motion = _chain(now_s, self._segment(now_s).angle_at(now_s), [(0.0, 0.0, 0.0)])
            self._homing = False
            self._flags.add(flag)
            self._disabled = self._disabled or flag in DISABLING_FLAGS

    def power_cycle(self) -> None:
        """Switch the stage off and on. The shaft does not move.

        The counter starts at 0 and the reference is lost, except for a parked stage.
        """
        with self._lock:
            now_s = self._advance()
            angle_deg = self._segment(now_s).angle_at(now_s)
            self._motion = _chain(now_s, angle_deg, [(0.0, 0.0, 0.0)])
            self._homing = False
            self._disabled = self._estop
            self.power_ups += 1
            if not self.parked:
                self._offset_deg = angle_deg
                self._flags = {"WR"}
            if self._estop:
                self._flags.add("FH")
