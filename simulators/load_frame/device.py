"""The mechanics and the controller of a load frame: crosshead, limits, watchdog and emergency stop.

This module contains no registers. The module `simulators.load_frame.modbus` connects a load frame to a
network or a serial line.
"""

import math
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from enum import Enum

import numpy as np

from drivers.clock import Clock
from simulators.load_frame.crosshead import CONTROL_PERIOD_S, ControlMode, Crosshead, LoadString
from simulators.load_frame.drive import Drive, DriveSettings
from simulators.load_frame.load_cell import Lie, LoadCell, LoadCellSettings
from simulators.load_frame.state import FaultCode, FrameReadings, MachineLimits, Refusal, RefusedError

DISPLACEMENT_NOISE_MM = 0.2e-3


class SpeedFault(Enum):
    """What is wrong with the machine's changes of speed."""

    NONE = "none"
    STUCK = "stuck"
    """The controller confirms and reports the new speed, but the crosshead keeps the old one."""
    WRONG = "wrong"
    """The controller takes, and reports, half of the commanded speed."""


class LoadFrameDevice:
    """A simulated tensile load frame with a control period of 20 ms.

    Parameters
    ----------
    clock : Clock
        The clock of the simulated motion.
    load_string : LoadString
    load_min_n, load_max_n, displacement_min_mm, displacement_max_mm : float
    speed_max_mm_s, load_rate_max_n_s : float
        The machine's ratings, which are the widest limits that can be set. If load or displacement exceeds a
        rating, relative to the machine's own zero, the machine stops with a fault.
    rng : numpy.random.Generator, optional
        Source of the noise of load cell and displacement (0.2 µm). Without a source, there is no noise.

    Attributes
    ----------
    executed : list of (float, str)
        Time and name of every command that the machine executed, even if its answer was lost.
    power_ups : int
        How often the machine was switched on.
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
        speed_max_mm_s: float = 10.0,
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
        self._load_noise_n = LoadCellSettings().noise_n
        self._crosshead = Crosshead(load_string)
        self._estop = False
        self._cell_broken = False
        self._watchdog_lost = False
        self._speed_fault = SpeedFault.NONE
        self._frozen: FrameReadings | None = None
        self._switch_on()

    def _switch_on(self) -> None:
        """Reset the values that a real controller loses without power: zeros, limits, watchdog, counter."""
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

    def mount_load_cell(self, settings: LoadCellSettings) -> None:
        """Mount a load cell with the given noise and error, whose reading without load is zero."""
        with self._lock:
            self._load_noise_n = settings.noise_n
            self._crosshead.cell = LoadCell(settings.error_percent)

    def fit_drive(self, settings: DriveSettings) -> None:
        """Fit a drive with the given acceleration and lag."""
        with self._lock:
            self._crosshead.drive = Drive(settings, CONTROL_PERIOD_S)

    def load_n(self) -> float:
        """The present real load in N, relative to the zero set by `tare`."""
        with self._now():
            return self._crosshead.load_n

    def displacement_mm(self) -> float:
        """The present real position of the crosshead in mm, relative to the zero set by `tare`."""
        with self._now():
            return self._crosshead.displacement_mm

    @property
    def limits(self) -> MachineLimits:
        """The active limits of the machine."""
        return self._limits

    def set_limits(self, limits: MachineLimits) -> None:
        """Set the limits; raise `RefusedError` for limits beyond the ratings of the machine."""
        if not self.ratings.encloses(limits):
            raise RefusedError(Refusal.BEYOND_LIMITS)
        with self._now():
            self._limits = limits

    @property
    def watchdog_s(self) -> float:
        """Time in s without a new heartbeat after which the watchdog stops a motion; 0 for no watchdog."""
        return self._watchdog_s

    def set_watchdog(self, timeout_s: float) -> None:
        """Set the time limit of the watchdog in s; 0 switches the watchdog off."""
        if not 0 <= timeout_s <= 60:
            raise RefusedError(Refusal.BEYOND_LIMITS)
        with self._now():
            self._watchdog_s = 0.0 if self._watchdog_lost else timeout_s
            self._beat_tick = self._tick

    @property
    def heartbeat(self) -> int:
        """The value of the last received heartbeat."""
        return self._heartbeat

    def beat(self, value: int) -> None:
        """Receive a heartbeat. If its value is unchanged, the watchdog's time continues to run."""
        with self._now():
            if value != self._heartbeat:
                self._heartbeat = value
                self._beat_tick = self._tick

    def read(self) -> FrameReadings:
        """Return the readings. The readings do not change within one control period."""
        with self._now():
            if self._noise_tick != self._tick:
                self._noise_tick = self._tick
                self._noise = self._draw_noise()
            load_error_n, displacement_error_mm = self._noise
            crosshead = self._crosshead
            readings = FrameReadings(
                sample=self._tick,
                time_s=self._tick * CONTROL_PERIOD_S,
                moving=crosshead.moving,
                at_target=crosshead.at_target,
                holding=crosshead.control is ControlMode.HOLD,
                fault=self._fault,
                estop=self._estop,
                load_n=math.nan if self._cell_broken else crosshead.shown_n + load_error_n,
                displacement_mm=crosshead.displacement_mm + displacement_error_mm,
                speed_mm_s=crosshead.speed_mm_s,
                set_speed_mm_s=crosshead.set_mm_s,
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
        """Begin to approach a position at constant speed; raise `RefusedError` beyond the limits."""
        with self._lock:
            limits = self._limits
            inside = limits.displacement_min_mm <= displacement_mm <= limits.displacement_max_mm
            self._go(ControlMode.DISPLACEMENT, displacement_mm, inside, speed_mm_s, limits.speed_max_mm_s)

    def go_to_load(self, load_n: float, rate_n_s: float) -> None:
        """Begin to approach a load along a ramp; raise `RefusedError` beyond the limits."""
        with self._lock:
            limits = self._limits
            inside = limits.load_min_n <= load_n <= limits.load_max_n
            self._go(ControlMode.LOAD, load_n, inside, rate_n_s, limits.load_rate_max_n_s)

    def change_speed(self, speed_mm_s: float) -> None:
        """Go on to the same position at another speed; raise `RefusedError` without such a motion."""
        with self._now():
            crosshead = self._crosshead
            if not 0 < speed_mm_s <= self._limits.speed_max_mm_s:
                raise RefusedError(Refusal.TOO_FAST)
            if crosshead.control is not ControlMode.DISPLACEMENT or crosshead.at_target:
                raise RefusedError(Refusal.NO_MOTION)
            self._note(f"speed {speed_mm_s:g}")
            match self._speed_fault:
                case SpeedFault.STUCK:
                    crosshead.change_speed(crosshead.rate_mm_s, speed_mm_s)
                case SpeedFault.WRONG:
                    crosshead.change_speed(0.5 * speed_mm_s, 0.5 * speed_mm_s)
                case _:
                    crosshead.change_speed(speed_mm_s, speed_mm_s)

    def hold(self) -> None:
        """Brake the crosshead, and hold its position."""
        with self._now():
            self._note("hold")
            self._crosshead.hold()

    def tare(self) -> None:
        """Set the zeros to the current load and position; raise `RefusedError` during motion."""
        with self._now():
            if self.read().moving:
                raise RefusedError(Refusal.NOT_READY)
            self._note("tare")
            self._crosshead.tare()

    def press_estop(self) -> None:
        """Open the emergency stop chain. The crosshead stops and refuses motion until `release_estop`."""
        with self._now():
            self._estop = True
            self._trip(FaultCode.ESTOP)

    def release_estop(self) -> None:
        """Close the emergency stop chain again. The crosshead does not move before the next command."""
        self._estop = False

    def hit_limit_switch(self) -> None:
        """Stop with a fault, as when the crosshead runs into a limit switch."""
        with self._now():
            self._trip(FaultCode.DISPLACEMENT_LIMIT)

    def jam(self) -> None:
        """Block the crosshead: the present motion and every later motion stop at once with a fault."""
        with self._now():
            self._crosshead.jammed = True

    def free(self) -> None:
        """Unblock the crosshead."""
        with self._now():
            self._crosshead.jammed = False

    def break_load_cell(self, broken: bool) -> None:
        """Make every load reading NaN if `broken` is True; make it a number again if `broken` is False."""
        self._cell_broken = broken

    def lie(self, lie: Lie, drift_n_s: float = 0.0) -> None:
        """Make the load cell show a wrong load, also to the machine's own controller.

        Parameters
        ----------
        lie : Lie
            The kind of wrong reading; with `Lie.NONE` the load cell shows the real load again.
        drift_n_s : float
            For `Lie.DRIFTING`: the rate at which the shown load falls below the real load, in N/s.
        """
        with self._now():
            self._crosshead.lie(lie, drift_n_s)

    def freeze(self) -> None:
        """Freeze the readings and their sample counter. The machine continues to work."""
        with self._lock:
            self._frozen = self.read()

    def thaw(self) -> None:
        """Let the readings change again after `freeze`."""
        self._frozen = None

    def lose_watchdog(self, lost: bool) -> None:
        """Switch the watchdog off. While `lost` is True, the watchdog cannot be switched on again."""
        with self._now():
            self._watchdog_lost = lost
            self._watchdog_s = 0.0

    def spoil_speed(self, fault: SpeedFault) -> None:
        """Let the later changes of speed fail in this way; `SpeedFault.NONE` repairs them."""
        with self._lock:
            self._speed_fault = fault

    def break_specimen(self) -> None:
        """Break the specimen in the grips."""
        with self._now():
            self._crosshead.break_string()

    def power_cycle(self) -> None:
        """Switch the machine off and on. The crosshead does not move; zeros, limits and watchdog are lost."""
        with self._now():
            self._switch_on()

    @contextmanager
    def _now(self) -> Iterator[None]:
        """Hold the machine's lock, after simulating all control periods up to the current time."""
        with self._lock:
            self._advance()
            yield

    def _note(self, command: str) -> None:
        self.executed.append((self._clock.now_s(), command))

    def _go(self, control: ControlMode, target: float, inside: bool, rate: float, rate_max: float) -> None:
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
        """Simulate all control periods up to the current time."""
        due = math.floor((self._clock.now_s() - self._start_s) / CONTROL_PERIOD_S)
        while self._tick < due and self._crosshead.moving:
            self._tick += 1
            self._crosshead.wait_until(self._tick * CONTROL_PERIOD_S)
            silence_s = (self._tick - self._beat_tick) * CONTROL_PERIOD_S
            tripped = 0 < self._watchdog_s < silence_s
            fault = FaultCode.WATCHDOG if tripped else self._crosshead.follow(self._limits, self.ratings)
            if fault is not FaultCode.NONE:
                self._trip(fault)
        self._tick = max(self._tick, due)
        self._crosshead.wait_until(self._tick * CONTROL_PERIOD_S)

    def _trip(self, fault: FaultCode) -> None:
        self._crosshead.stand(ControlMode.HOLD)
        self._fault = fault

    def _draw_noise(self) -> tuple[float, float]:
        if self._rng is None:
            return 0.0, 0.0
        load, displacement = self._rng.standard_normal(2)
        if self._crosshead.cell.is_stuck:
            load = 0.0
        return self._load_noise_n * float(load), DISPLACEMENT_NOISE_MM * float(displacement)
