"""The mechanics and the controller of a load frame: crosshead, limits, watchdog and emergency stop.

It knows nothing of registers; `simulators.load_frame.modbus` puts it on a network.
"""

import math
import threading
from dataclasses import replace

import numpy as np

from drivers.clock import Clock
from simulators.load_frame.crosshead import CONTROL_PERIOD_S, Control, Crosshead, LoadString
from simulators.load_frame.state import FaultCode, MachineLimits, Readings, Refusal, RefusedError

LOAD_NOISE_N = 2.0
DISPLACEMENT_NOISE_MM = 0.2e-3


class LoadFrameDevice:
    """A tensile frame of ±`load_max_n` with a travel of `displacement_max_mm`, in periods of 20 ms.

    Parameters
    ----------
    clock : Clock
        The machine's physics runs on this clock's time.
    load_string : LoadString
    load_min_n, load_max_n, displacement_min_mm, displacement_max_mm : float
    speed_max_mm_s, load_rate_max_n_s : float
        The machine's ratings: the widest limits that can be set. Beyond them the machine stops with a fault,
        measured from its own zero.
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
        self.ratings = MachineLimits(
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
        self._rng = rng
        self._lock = threading.RLock()
        self._crosshead = Crosshead(load_string)
        self._estop = False
        self._cell_broken = False
        self._watchdog_lost = False
        self._frozen: Readings | None = None
        self._switch_on()

    def _switch_on(self) -> None:
        """Reset what a real controller loses without power: zeros, limits, watchdog and sample counter."""
        self.power_ups += 1
        self._start_s = self._clock.now_s()
        self._tick = 0
        self._limits = self.ratings
        self._crosshead.reset()
        self._fault = FaultCode.ESTOP if self._estop else FaultCode.NONE
        self._watchdog_s = 0.0
        self._heartbeat = 0
        self._beat_tick = 0
        self._noise_tick = -1
        self._noise = (0.0, 0.0)

    def load_n(self) -> float:
        """True load in the string now, from the zero set by `tare`."""
        with self._lock:
            self._advance()
            return self._crosshead.load_n

    def displacement_mm(self) -> float:
        """True position of the crosshead now, from the zero set by `tare`."""
        with self._lock:
            self._advance()
            return self._crosshead.displacement_mm

    @property
    def limits(self) -> MachineLimits:
        """The limits that are active."""
        return self._limits

    def set_limits(self, limits: MachineLimits) -> None:
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
        """Return the readings; within one control period they do not change."""
        with self._lock:
            self._advance()
            if self._noise_tick != self._tick:
                self._noise_tick = self._tick
                self._noise = self._draw_noise()
            load_error_n, displacement_error_mm = self._noise
            crosshead = self._crosshead
            readings = Readings(
                sample=self._tick,
                time_s=self._tick * CONTROL_PERIOD_S,
                moving=crosshead.moving,
                at_target=crosshead.at_target,
                holding=crosshead.control is Control.HOLD,
                fault=self._fault,
                estop=self._estop,
                load_n=math.nan if self._cell_broken else crosshead.load_n + load_error_n,
                displacement_mm=crosshead.displacement_mm + displacement_error_mm,
                speed_mm_s=crosshead.speed_mm_s,
                target=crosshead.target,
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

    def hold(self) -> None:
        """Stop and hold position."""
        with self._lock:
            self._advance()
            self._note("hold")
            self._crosshead.stand(Control.HOLD)

    def tare(self) -> None:
        """Make the present load and position the zero; `RefusedError` while moving."""
        with self._lock:
            self._advance()
            if self.read().moving:
                raise RefusedError(Refusal.NOT_READY)
            self._note("tare")
            self._crosshead.tare()

    def press_estop(self) -> None:
        """Open the emergency stop chain: the crosshead stands until a command after the chain was closed."""
        with self._lock:
            self._advance()
            self._estop = True
            self._trip(FaultCode.ESTOP)

    def release_estop(self) -> None:
        """Close the emergency stop chain again; nothing moves by itself."""
        self._estop = False

    def hit_limit_switch(self) -> None:
        """Stop with a fault, as when the crosshead runs into a limit switch."""
        with self._lock:
            self._advance()
            self._trip(FaultCode.DISPLACEMENT_LIMIT)

    def jam(self) -> None:
        """Block the crosshead: a motion under way stalls, and so does every one that is begun."""
        with self._lock:
            self._advance()
            self._crosshead.jammed = True

    def free(self) -> None:
        """Take away what blocks the crosshead."""
        with self._lock:
            self._advance()
            self._crosshead.jammed = False

    def break_load_cell(self, broken: bool) -> None:
        """Make the load reading NaN, or a number again."""
        self._cell_broken = broken

    def freeze(self) -> None:
        """Freeze the readings and their counter, while the machine goes on."""
        with self._lock:
            self._frozen = self.read()

    def thaw(self) -> None:
        """Let the readings follow the machine again after `freeze`."""
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
            self._crosshead.break_string()

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
        self._crosshead.begin(control, target, rate)
        self._fault = FaultCode.NONE
        self._beat_tick = self._tick

    def _advance(self) -> None:
        """Carry out every control period that was due until now."""
        due = math.floor((self._clock.now_s() - self._start_s) / CONTROL_PERIOD_S)
        while self._tick < due and self._crosshead.moving:
            self._tick += 1
            silence_s = (self._tick - self._beat_tick) * CONTROL_PERIOD_S
            tripped = 0 < self._watchdog_s < silence_s
            fault = FaultCode.WATCHDOG if tripped else self._crosshead.follow(self._limits, self.ratings)
            if fault is not FaultCode.NONE:
                self._trip(fault)
        self._tick = max(self._tick, due)

    def _trip(self, fault: FaultCode) -> None:
        self._crosshead.stand(Control.HOLD)
        self._fault = fault

    def _draw_noise(self) -> tuple[float, float]:
        if self._rng is None:
            return 0.0, 0.0
        load, displacement = self._rng.standard_normal(2)
        return LOAD_NOISE_N * float(load), DISPLACEMENT_NOISE_MM * float(displacement)
