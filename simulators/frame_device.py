"""The load frame as a thing: a crosshead, a load string, a controller with limits and a watchdog.

It knows nothing of registers; `simulators.frame_wire` puts it on a network.
"""

import math
import threading
from dataclasses import replace
from enum import Enum
from typing import Protocol

import numpy as np

from drivers.clock import Clock
from simulators.frame_state import Fault, Limits, Readings, Refusal, RefusedError

CONTROL_PERIOD_S = 0.02
LOAD_NOISE_N = 2.0
DISPLACEMENT_NOISE_MM = 0.2e-3
LOAD_TOLERANCE_N = 1.0
TRAVEL_TOLERANCE_MM = 1e-4
# What the load controller believes before it has seen the specimen answer, and what it never falls below:
# too soft a belief makes the crosshead jump when a slack string tightens.
STIFFNESS_GUESS_N_MM = 10_000.0
STIFFNESS_MIN_N_MM = 1_000.0


class LoadString(Protocol):
    """Specimen, grips and frame in series; it remembers plastic deformation."""

    def stretch_to(self, displacement_mm: float) -> float:
        """Bring the crosshead to `displacement_mm` from the start of the test and return the load in N."""

    def break_now(self) -> None:
        """Break; no load is carried from now on."""


class Control(Enum):
    """What the crosshead follows."""

    HOLD = "hold"
    DISPLACEMENT = "displacement"
    LOAD = "load"


class FrameDevice:
    """A tensile frame of ±`load_max_n` with a travel of `displacement_max_mm`, in periods of 20 ms.

    Parameters
    ----------
    clock : Clock
        The machine's physics runs on this clock's time.
    load_string : LoadString
    load_min_n, load_max_n, displacement_min_mm, displacement_max_mm : float
    speed_max_mm_s, load_rate_max_n_s : float
        The machine's ratings: the widest limits that can be set.
    rng : numpy.random.Generator, optional
        Source of the measurement noise (2 N and 0.2 µm); without one there is none.

    Attributes
    ----------
    executed : list of (float, str)
        Every command that was taken, with its time: what the machine did, whatever its answers said.
    power_ups : int
        How often it was switched on.
    """

    def __init__(
        self,
        clock: Clock,
        load_string: LoadString,
        *,
        load_min_n: float = -50_000.0,
        load_max_n: float = 50_000.0,
        displacement_min_mm: float = -10.0,
        displacement_max_mm: float = 100.0,
        speed_max_mm_s: float = 5.0,
        load_rate_max_n_s: float = 10_000.0,
        rng: np.random.Generator | None = None,
    ) -> None:
        self.ratings = Limits(
            load_min_n,
            load_max_n,
            displacement_min_mm,
            displacement_max_mm,
            speed_max_mm_s,
            load_rate_max_n_s,
        )
        self.executed: list[tuple[float, str]] = []
        self.power_ups = 0
        self._clock = clock
        self._string = load_string
        self._rng = rng
        self._lock = threading.RLock()
        self._position_mm = 0.0
        self._force_n = load_string.stretch_to(0.0)
        self._estop = False
        self._jammed = False
        self._cell_broken = False
        self._watchdog_lost = False
        self._frozen: Readings | None = None
        self._switch_on()

    def _switch_on(self) -> None:
        """Forget what a controller forgets: its zeros, limits, watchdog and count of samples."""
        self.power_ups += 1
        self._start_s = self._clock.now_s()
        self._tick = 0
        self._limits = self.ratings
        self._zero_mm = 0.0
        self._zero_n = 0.0
        self._stiffness_n_mm = STIFFNESS_GUESS_N_MM
        self._control = Control.HOLD
        self._target = 0.0
        self._rate = 0.0
        self._setpoint_n = 0.0
        self._speed_mm_s = 0.0
        self._at_target = False
        self._fault = Fault.ESTOP if self._estop else Fault.NONE
        self._watchdog_s = 0.0
        self._heartbeat = 0
        self._beat_tick = 0
        self._noise_tick = -1
        self._noise = (0.0, 0.0)

    def load_n(self) -> float:
        """True load in the string now, from the zero set by `tare`."""
        with self._lock:
            self._advance()
            return self._force_n - self._zero_n

    def displacement_mm(self) -> float:
        """True position of the crosshead now, from the zero set by `tare`."""
        with self._lock:
            self._advance()
            return self._position_mm - self._zero_mm

    @property
    def limits(self) -> Limits:
        """The limits that are active."""
        return self._limits

    def set_limits(self, limits: Limits) -> None:
        """Narrow the limits; `RefusedError` beyond the ratings."""
        if not self.ratings.encloses(limits):
            raise RefusedError(Refusal.BEYOND_LIMITS)
        with self._lock:
            self._advance()
            self._limits = limits

    @property
    def watchdog_s(self) -> float:
        """Longest time without a new heartbeat while moving; 0 switches the watchdog off."""
        return self._watchdog_s

    def set_watchdog(self, timeout_s: float) -> None:
        """Set the watchdog's time."""
        if not 0 <= timeout_s <= 60:
            raise RefusedError(Refusal.BEYOND_LIMITS)
        with self._lock:
            self._advance()
            self._watchdog_s = 0.0 if self._watchdog_lost else timeout_s
            self._beat_tick = self._tick

    @property
    def heartbeat(self) -> int:
        """The last heartbeat received."""
        return self._heartbeat

    def beat(self, value: int) -> None:
        """Receive a heartbeat: only a changed value counts."""
        with self._lock:
            self._advance()
            if value != self._heartbeat:
                self._heartbeat = value
                self._beat_tick = self._tick

    def read(self) -> Readings:
        """Indicate the state; within one control period always the same."""
        with self._lock:
            self._advance()
            if self._noise_tick != self._tick:
                self._noise_tick = self._tick
                self._noise = self._draw_noise()
            load_error_n, displacement_error_mm = self._noise
            readings = Readings(
                sample=self._tick,
                time_s=self._tick * CONTROL_PERIOD_S,
                moving=self._control is not Control.HOLD and not self._at_target,
                at_target=self._at_target,
                holding=self._control is Control.HOLD,
                fault=self._fault,
                estop=self._estop,
                load_n=math.nan if self._cell_broken else self._force_n - self._zero_n + load_error_n,
                displacement_mm=self._position_mm - self._zero_mm + displacement_error_mm,
                speed_mm_s=self._speed_mm_s,
                target=self._target,
            )
            if (frozen := self._frozen) is None:
                return readings
            return replace(
                readings,
                sample=frozen.sample,
                time_s=frozen.time_s,
                load_n=frozen.load_n,
                displacement_mm=frozen.displacement_mm,
            )

    def go_to_displacement(self, displacement_mm: float, speed_mm_s: float) -> None:
        """Begin to approach a position at constant speed; `RefusedError` beyond the limits."""
        with self._lock:
            limits = self._limits
            inside = limits.displacement_min_mm <= displacement_mm <= limits.displacement_max_mm
            self._go(Control.DISPLACEMENT, displacement_mm, inside, speed_mm_s, limits.speed_max_mm_s)

    def go_to_load(self, load_n: float, rate_n_s: float) -> None:
        """Begin to approach a load along a ramp; `RefusedError` beyond the limits."""
        with self._lock:
            limits = self._limits
            inside = limits.load_min_n <= load_n <= limits.load_max_n
            self._go(Control.LOAD, load_n, inside, rate_n_s, limits.load_rate_max_n_s)
            self._setpoint_n = self._force_n - self._zero_n

    def hold(self) -> None:
        """Stop and hold position."""
        with self._lock:
            self._advance()
            self._note("hold")
            self._stand(Control.HOLD)
            self._at_target = False

    def tare(self) -> None:
        """Make the present load and position the zero; `RefusedError` while moving."""
        with self._lock:
            self._advance()
            if self.read().moving:
                raise RefusedError(Refusal.NOT_READY)
            self._note("tare")
            self._zero_n, self._zero_mm = self._force_n, self._position_mm
            self._stand(Control.HOLD)
            self._at_target = False

    def press_estop(self) -> None:
        """Open the emergency stop chain: the crosshead stands until it is closed and a new command comes."""
        with self._lock:
            self._advance()
            self._estop = True
            self._trip(Fault.ESTOP)

    def release_estop(self) -> None:
        """Close the emergency stop chain again; nothing moves by itself."""
        self._estop = False

    def hit_limit_switch(self) -> None:
        """Trip as a limit switch does that the crosshead runs into."""
        with self._lock:
            self._advance()
            self._trip(Fault.DISPLACEMENT_LIMIT)

    def jam(self) -> None:
        """Block the crosshead: a motion under way stalls, and so does every one that is begun."""
        with self._lock:
            self._advance()
            self._jammed = True

    def free(self) -> None:
        """Take away what blocks the crosshead."""
        with self._lock:
            self._advance()
            self._jammed = False

    def break_load_cell(self, broken: bool) -> None:
        """Let the load be no number, or a number again."""
        self._cell_broken = broken

    def freeze(self) -> None:
        """Let the readings and their counter stand still; the machine goes on."""
        with self._lock:
            self._frozen = self.read()

    def thaw(self) -> None:
        """Let the readings follow the machine again."""
        self._frozen = None

    def lose_watchdog(self, lost: bool) -> None:
        """Switch the watchdog off for good, or let it be set again."""
        with self._lock:
            self._advance()
            self._watchdog_lost = lost
            self._watchdog_s = 0.0

    def break_specimen(self) -> None:
        """Break what is in the grips."""
        with self._lock:
            self._advance()
            self._string.break_now()
            self._force_n = self._string.stretch_to(self._position_mm)

    def power_cycle(self) -> None:
        """Switch off and on: the crosshead stays where it is; zeros, limits and the watchdog are lost."""
        with self._lock:
            self._advance()
            self._switch_on()

    def _note(self, command: str) -> None:
        self.executed.append((self._clock.now_s(), command))

    def _go(self, control: Control, target: float, inside: bool, rate: float, rate_max: float) -> None:
        self._advance()
        if self._estop:
            raise RefusedError(Refusal.NOT_READY)
        if not inside:
            raise RefusedError(Refusal.BEYOND_LIMITS)
        if not 0 < rate <= rate_max:
            raise RefusedError(Refusal.TOO_FAST)
        self._note(f"{control.value} {target:g} at {rate:g}")
        self._control, self._target, self._rate = control, target, rate
        self._at_target = False
        self._fault = Fault.NONE
        self._beat_tick = self._tick

    def _advance(self) -> None:
        """Let every control period happen that was due until now."""
        due = math.floor((self._clock.now_s() - self._start_s) / CONTROL_PERIOD_S)
        while self._tick < due and self._control is not Control.HOLD and not self._at_target:
            self._tick += 1
            silence_s = (self._tick - self._beat_tick) * CONTROL_PERIOD_S
            if 0 < self._watchdog_s < silence_s:
                self._trip(Fault.WATCHDOG)
            else:
                self._follow()
        self._tick = max(self._tick, due)

    def _follow(self) -> None:
        if self._jammed:
            self._trip(Fault.STALL)
            return
        if self._control is Control.DISPLACEMENT:
            wanted_mm = self._target - (self._position_mm - self._zero_mm)
            speed_mm_s = self._rate
        else:
            ramp_n = self._rate * CONTROL_PERIOD_S
            self._setpoint_n += min(max(self._target - self._setpoint_n, -ramp_n), ramp_n)
            wanted_mm = (self._setpoint_n - (self._force_n - self._zero_n)) / self._stiffness_n_mm
            speed_mm_s = self._limits.speed_max_mm_s
        reach_mm = speed_mm_s * CONTROL_PERIOD_S
        step_mm = min(max(wanted_mm, -reach_mm), reach_mm)
        self._step(step_mm)
        if self._beyond_limits(step_mm):
            return
        if self._control is Control.DISPLACEMENT:
            arrived = step_mm == wanted_mm
        else:
            error_n = self._target - (self._force_n - self._zero_n)
            arrived = self._setpoint_n == self._target and abs(error_n) <= LOAD_TOLERANCE_N
        if arrived:
            self._stand(self._control)
            self._at_target = True

    def _step(self, step_mm: float) -> None:
        before_n = self._force_n
        self._position_mm += step_mm
        self._force_n = self._string.stretch_to(self._position_mm)
        self._speed_mm_s = step_mm / CONTROL_PERIOD_S
        if step_mm:
            self._stiffness_n_mm = max((self._force_n - before_n) / step_mm, STIFFNESS_MIN_N_MM)

    def _beyond_limits(self, step_mm: float) -> bool:
        """Trip when a limit is passed on the way out; the way back is free."""
        limits = self._limits
        load_n, displacement_mm = self._force_n - self._zero_n, self._position_mm - self._zero_mm
        if step_mm > 0:
            overload = load_n > limits.load_max_n + LOAD_TOLERANCE_N
            overtravel = displacement_mm > limits.displacement_max_mm + TRAVEL_TOLERANCE_MM
        else:
            overload = load_n < limits.load_min_n - LOAD_TOLERANCE_N
            overtravel = displacement_mm < limits.displacement_min_mm - TRAVEL_TOLERANCE_MM
        if overload:
            self._trip(Fault.LOAD_LIMIT)
        elif overtravel:
            self._trip(Fault.DISPLACEMENT_LIMIT)
        return self._control is Control.HOLD

    def _trip(self, fault: Fault) -> None:
        self._stand(Control.HOLD)
        self._at_target = False
        self._fault = fault

    def _stand(self, control: Control) -> None:
        self._control = control
        self._speed_mm_s = 0.0

    def _draw_noise(self) -> tuple[float, float]:
        if self._rng is None:
            return 0.0, 0.0
        load, displacement = self._rng.standard_normal(2)
        return LOAD_NOISE_N * float(load), DISPLACEMENT_NOISE_MM * float(displacement)
