"""The mechanics of a rotation stage: a shaft that accelerates and turns, a counter, warning flags and limits.

It knows nothing of bytes; `simulators.stage.zaber` puts it on a line.
"""

import threading
from collections.abc import Iterable
from dataclasses import dataclass

from drivers.clock import Clock

# Flags that end a motion and forbid the next one until the driver is enabled again.
DISABLING_FLAGS = ("FD", "FO", "FH", "FV")
HOMING_BACKOFF_DEG = 2.0


class RefusedError(Exception):
    """The stage does not accept a command; the text is the protocol's reason, such as ``BADDATA``."""


@dataclass(frozen=True)
class Segment:
    """A stretch of motion under constant acceleration (degrees and seconds)."""

    start_s: float
    duration_s: float
    angle_deg: float
    speed_deg_s: float
    acceleration_deg_s2: float

    @property
    def end_s(self) -> float:
        """When the stretch is over."""
        return self.start_s + self.duration_s

    def angle_at(self, time_s: float) -> float:
        """Shaft angle within the stretch; held at its ends."""
        t = min(max(time_s - self.start_s, 0.0), self.duration_s)
        return self.angle_deg + self.speed_deg_s * t + self.acceleration_deg_s2 * t * t / 2

    def speed_at(self, time_s: float) -> float:
        """Shaft speed within the stretch."""
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
    """Return the motion that brakes from `speed_deg_s` to a standstill."""
    deceleration = -deceleration_deg_s2 if speed_deg_s > 0 else deceleration_deg_s2
    return _chain(time_s, angle_deg, [(abs(speed_deg_s) / deceleration_deg_s2, speed_deg_s, deceleration)])


def trapezoid(
    time_s: float, start_deg: float, end_deg: float, speed_deg_s: float, acceleration_deg_s2: float
) -> list[Segment]:
    """Return the motion from rest to rest: accelerate, cruise, brake; short moves never reach full speed."""
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
        The stage's physics runs on this clock's time.
    power_up_angle_deg : float
        Angle of the shaft when the stage is switched on. The counter starts at 0 whatever the angle is,
        without a reference (flag WR), until the stage is homed.
    microsteps_per_deg : int
    speed_deg_s, acceleration_deg_s2 : float
        The settings `maxspeed` and `accel` after switching on.
    limit_min_deg, limit_max_deg : float
        The settings `limit.min` and `limit.max` after switching on; a rotary stage may turn many times.

    Attributes
    ----------
    executed : list of (float, str)
        Every motion that was begun, with its time, whether or not the answer reached the client.
    power_ups : int
        How often it was switched on.
    parked : bool
        Whether it was told to keep its position and its reference over a power cut, and to refuse motion.
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
        """True angle of the shaft now; positive turns X towards Y."""
        with self._lock:
            now_s = self._advance()
            return self._segment(now_s).angle_at(now_s)

    @property
    def position(self) -> int:
        """The counter, in microsteps."""
        with self._lock:
            return round((self.angle_deg() - self._offset_deg) * self.microsteps_per_deg)

    @property
    def speed_deg_s(self) -> float:
        """True speed of the shaft now."""
        with self._lock:
            now_s = self._advance()
            return self._segment(now_s).speed_at(now_s) if now_s < self._motion[-1].end_s else 0.0

    @property
    def enabled(self) -> bool:
        """Whether the motor driver is on."""
        return not self._disabled

    @property
    def moving(self) -> bool:
        """True until the last commanded motion has ended."""
        with self._lock:
            return self._advance() < self._motion[-1].end_s

    @property
    def flags(self) -> list[str]:
        """Active warning flags, gravest first (F before W before N)."""
        with self._lock:
            self._advance()
            return sorted(self._flags, key=lambda flag: ("FWN".index(flag[0]), flag))

    def _segment(self, now_s: float) -> Segment:
        return next((s for s in self._motion if now_s < s.end_s), self._motion[-1])

    def _advance(self) -> float:
        """Carry out what was due until now, and return the time."""
        now_s = self._clock.now_s()
        if self._homing and now_s >= self._motion[-1].end_s:
            self._homing = False
            self._offset_deg = 0.0
            self._flags -= {"WR", "WH"}
        return now_s

    def _start(
        self, name: str, plan: list[float], speed: float | None = None, acceleration: float | None = None
    ) -> None:
        """Begin to visit shaft angles one after the other; a motion under way is braked first."""
        if self._disabled:
            raise RefusedError("DRIVERDISABLED")
        if self.parked:
            raise RefusedError("PARKED")
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
        """Begin to seek the index mark: past it, then onto it from below; `RefusedError` when disabled."""
        with self._lock:
            self._start("home", [-HOMING_BACKOFF_DEG, 0.0])
            self._homing = not self._jammed

    def move_to(self, position: int, speed: float | None = None, acceleration: float | None = None) -> None:
        """Begin to move to a counter value, with a speed and acceleration of its own if they are given.

        `RefusedError` beyond the limits or when disabled.
        """
        with self._lock:
            self._require_within(position)
            angle_deg = position / self.microsteps_per_deg + self._offset_deg
            self._start(f"move {position}", [angle_deg], speed, acceleration)

    def move_by(self, distance: int, speed: float | None = None, acceleration: float | None = None) -> None:
        """Begin to move by a distance in microsteps from where the shaft is now."""
        with self._lock:
            self.move_to(self.position + distance, speed, acceleration)

    def turn(self, speed: float, acceleration: float | None = None) -> None:
        """Begin to turn at a speed in microsteps/s, until a limit or the next motion; 0 is a stop."""
        with self._lock:
            if speed == 0:
                self.stop()
                return
            end = self.limit_max if speed > 0 else self.limit_min
            angle_deg = end / self.microsteps_per_deg + self._offset_deg
            self._start(f"turn {speed:g}", [angle_deg], abs(speed), acceleration)

    def park(self) -> None:
        """Keep position and reference over the next power cut; `RefusedError` while moving."""
        with self._lock:
            if self.moving:
                raise RefusedError("STATUSBUSY")
            self.parked = True

    def set_position(self, position: int) -> None:
        """Give the counter a new value; the shaft stays."""
        with self._lock:
            self._offset_deg = self.angle_deg() - position / self.microsteps_per_deg

    def stop(self, acceleration: float | None = None) -> None:
        """Brake to a standstill. A motion that is cut short raises NI."""
        with self._lock:
            if self.moving:
                self._start("stop", [], acceleration=acceleration)

    def _require_within(self, position: int) -> None:
        if not self.limit_min <= position <= self.limit_max:
            raise RefusedError("BADDATA")

    def clear_flags(self) -> None:
        """Clear the flags of past events; a lost reference and a disabled driver remain."""
        with self._lock:
            self._flags &= {"WR", "WH", *(DISABLING_FLAGS if self._disabled else ())}

    def enable_driver(self) -> None:
        """Switch the motor driver on again; `RefusedError` while the emergency stop is pressed."""
        with self._lock:
            if self._estop:
                raise RefusedError("DRIVERDISABLED")
            self._disabled = False
            self._flags -= set(DISABLING_FLAGS)

    def disable_driver(self) -> None:
        """Switch the motor driver off; a motion ends at once."""
        self.fail("FO")

    def jam(self) -> None:
        """Block the shaft: a motion under way stalls, and so does every one that is begun."""
        with self._lock:
            self._jammed = True
            if self.moving:
                self.fail("FS")

    def free(self) -> None:
        """Remove what blocks the shaft."""
        self._jammed = False

    def press_estop(self) -> None:
        """Open the emergency stop chain: the driver is off until it is closed and the driver enabled."""
        self._estop = True
        self.fail("FH")

    def release_estop(self) -> None:
        """Close the emergency stop chain again; nothing moves by itself."""
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
        """Switch off and on: the shaft stays, the counter starts at 0 and the reference is lost."""
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
