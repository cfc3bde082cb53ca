"""Benches of stage and load frame, on each kind of line."""

import math
from collections.abc import Callable
from typing import Any

from drivers.clock import VirtualClock
from drivers.interfaces import OpenContext, RotationStage
from drivers.lines.stop_deadline import StopTimes
from drivers.load_frames.modbus.load_frame import open_frame
from drivers.load_frames.modbus.settings import ModbusLoadFrameSettings
from drivers.stages.settings import StageSettings
from simulators.load_frame.device import LoadFrameDevice
from simulators.load_frame.layout import LAYOUTS
from simulators.scene.specimen import SimulatedSpecimen, SpecimenSettings
from simulators.stage.device import StageDevice
from tests.fault_matrix.bench import STOP_TIMES, Bench, ReportedFault, WrongAnswerError

REPLY_TIMEOUT_S = 0.35
ON_FOR_S = 1000.0
"""Time in s for which a load frame was on before it is opened. So its counters show a later restart."""


class StageBench(Bench):
    """A rotation stage on one kind of line."""

    def __init__(
        self,
        serve: Callable[[StageDevice, VirtualClock], Any],
        settings: type[StageSettings],
        open_stage: Callable[[Any, OpenContext, StopTimes], RotationStage],
        prefix: str = "",
    ) -> None:
        super().__init__()
        self.device = StageDevice(self.clock, power_up_angle_deg=12.0)
        self._server = serve(self.device, self.clock)
        self.faults = self._server.faults
        self._settings, self._open_stage, self._prefix = settings, open_stage, prefix
        self._angle_deg = 20.0
        self._given: list[str] = []
        self.uses = {"read": self._read, "move": self._move, "stop": self._stop}
        self.ways_back = {
            "": lambda: None,
            "home": self.prepare,
            "open, home": lambda: (self.open(), self.prepare()),
        }

    def opened(self, context: OpenContext) -> Any:
        """Return the driver, opened."""
        settings = self._settings(
            port=self._prefix + self._server.address,
            angle_min_deg=-5.0,
            angle_max_deg=725.0,
            reply_timeout_s=REPLY_TIMEOUT_S,
        )
        return self._open_stage(settings, context, STOP_TIMES)

    def prepare(self) -> None:
        """Search for the reference position, and wait until the search has ended."""
        self.driver.home()
        self._arrive()

    def set_in_motion(self) -> None:
        """Begin a rotation by more than 100°, and let one second pass."""
        self._command(self._angle_deg + 150.0)
        self.clock.sleep(1.0)

    def works(self) -> None:
        """Read the stage, rotate it, and check that it arrives."""
        self._arrive()
        before = len(self.device.executed)
        angle_deg = self._move()
        self._arrive()
        if len(self.device.executed) != before + 1 or self._read() != angle_deg:
            raise WrongAnswerError(f"{angle_deg}° commanded, {self.device.executed[before:]} executed")

    def executed_twice(self) -> list[str]:
        """Return the moves that the stage has executed more often than the driver was called."""
        done = [name for _, name in self.device.executed if name.startswith("move")]
        return sorted({name for name in done if done.count(name) > self._given.count(name)})

    def close(self) -> None:
        """Close driver and line."""
        self.shut()
        self._server.close()

    def _arrive(self) -> None:
        for _ in range(2000):
            if not self.driver.read().moving:
                return
            self.clock.sleep(0.1)
        raise WrongAnswerError("moving for ever")

    def _read(self) -> float:
        self.clock.sleep(1.0)
        state = self.driver.read()
        counter_deg = self.device.position / self.device.microsteps_per_deg
        if abs(state.angle_deg - counter_deg) > 1e-3 or state.moving != self.device.moving:
            raise WrongAnswerError(f"read {state}, is {counter_deg}°, moving {self.device.moving}")
        if not state.homed:
            raise ReportedFault(state.warnings)
        return round(state.angle_deg, 3)

    def _move(self) -> float:
        self._angle_deg += 2.0
        before = len(self.device.executed)
        self._command(self._angle_deg)
        if len(self.device.executed) != before + 1:
            raise WrongAnswerError(f"{self.device.executed[before:]} executed for one command")
        return self._angle_deg

    def _command(self, angle_deg: float) -> None:
        self._given.append(f"move {round(angle_deg * self.device.microsteps_per_deg)}")
        self.driver.move_to(angle_deg)

    def _stop(self) -> None:
        self.driver.stop()
        if self.device.moving:
            raise WrongAnswerError("a stop confirmed for a stage in motion")


class LoadFrameBench(Bench):
    """A load frame on one kind of line, with one register map."""

    def __init__(self, serve: Callable[..., Any], map_name: str, prefix: str = "") -> None:
        super().__init__()
        self._specimen = SimulatedSpecimen(SpecimenSettings(grip_slip_mm=0.0))
        self.device = LoadFrameDevice(self.clock, self._specimen)
        self._server = serve(self.device, layout=LAYOUTS[map_name])
        self.faults = self._server.faults
        self.clock.sleep(ON_FOR_S)
        self._map, self._prefix = map_name, prefix
        self._travel_mm = 0.10
        self._given: list[float] = []
        self.uses = {"read": self._read, "move": self._move, "stop": self._hold}
        self.ways_back = {
            "": lambda: None,
            "hold": self._hold,
            "open, hold": lambda: (self.open(), self._hold()),
        }

    def opened(self, context: OpenContext) -> Any:
        """Return the driver, opened."""
        settings = ModbusLoadFrameSettings(
            address=self._prefix + self._server.address,
            map=self._map,
            load_max_n=12_000.0,
            displacement_max_mm=5.3,
            reply_timeout_s=REPLY_TIMEOUT_S,
            # a pseudo-terminal carries no parity bits
            **({"parity": "N"} if self._server.address.startswith("/") else {}),
        )
        return open_frame(settings, context, STOP_TIMES)

    def prepare(self) -> None:
        """Read once."""
        self._read()

    def set_in_motion(self) -> None:
        """Begin a motion of ten seconds."""
        self._command(self._travel_mm + 0.2, 0.02)
        self.clock.sleep(1.0)

    def works(self) -> None:
        """Read the load frame, move it, and check that it arrives."""
        before = len(self.device.executed)
        travel_mm = self._move()
        for _ in range(100):
            if not self.driver.read().moving:
                break
            self.clock.sleep(0.1)
        if len(self.device.executed) != before + 1 or abs(self._read() - travel_mm) > 1e-3:
            raise WrongAnswerError(f"{travel_mm} mm commanded, {self.device.executed[before:]} executed")

    def executed_twice(self) -> list[str]:
        """Return the moves that the machine has executed more often than the driver was called."""
        done = [float(name.split()[1]) for _, name in self.device.executed if name.startswith("displacement")]
        given = self._given
        return [
            f"{target:g} mm"
            for target in done
            if _count(done, target) > _count(given, target)
        ]  # fmt: skip

    def close(self) -> None:
        """Close driver and line."""
        self.shut()
        self._server.close()

    def _read(self) -> float:
        self.clock.sleep(0.2)
        self.driver.read()
        # by now nothing may be as old as the first reading could be
        self.clock.sleep(1.0)
        state = self.driver.read()
        off_mm = abs(state.displacement_mm - self.device.displacement_mm())
        if off_mm > 1e-3 or not math.isclose(state.load_n, self.device.load_n(), abs_tol=1.0):
            raise WrongAnswerError(f"read {state}, is {self.device.read()}")
        if state.faults:
            raise ReportedFault(state.faults)
        return float(state.displacement_mm)

    def _move(self) -> float:
        self._travel_mm += 0.02
        before = len(self.device.executed)
        self._command(self._travel_mm, 0.1)
        if len(self.device.executed) != before + 1:
            raise WrongAnswerError(f"{self.device.executed[before:]} executed for one command")
        return self._travel_mm

    def _command(self, travel_mm: float, speed_mm_s: float) -> None:
        self._given.append(travel_mm)
        self.driver.go_to_displacement(travel_mm, speed_mm_s)

    def _hold(self) -> None:
        self.driver.hold()
        if not self.device.read().holding:
            raise WrongAnswerError("a hold confirmed for a machine that does not hold")


class SpeedBench(LoadFrameBench):
    """A load frame in a long motion, whose speed is changed while the machine or its line has a fault."""

    def __init__(self, serve: Callable[..., Any], map_name: str, prefix: str = "") -> None:
        super().__init__(serve, map_name, prefix)
        self._speed_mm_s = 0.02
        self._changes: list[float] = []
        self._confirmed = False
        self.uses = {
            "change": lambda: self._change(0.11 - self._speed_mm_s),
            "travel": self._read_travel,
            "stop": self._hold,
        }

    def prepare(self) -> None:
        """Begin a motion of more than a minute."""
        self._command(self._travel_mm + 2.0, self._speed_mm_s)
        self.clock.sleep(1.0)
        self.driver.read()

    def set_in_motion(self) -> None:
        """Do nothing, because the crosshead moves already."""

    def executed_twice(self) -> list[str]:
        """Return the motions and changes that were executed more often than the driver was called."""
        done = [float(name.split()[1]) for _, name in self.device.executed if name.startswith("speed")]
        changes = self._changes
        return super().executed_twice() + [
            f"{speed:g} mm/s" for speed in done if _count(done, speed) > _count(changes, speed)
        ]

    def works(self) -> None:
        """Read the load frame, move it, change its speed on the way, and check that it arrives."""
        super().works()
        self._travel_mm += 0.1
        self._command(self._travel_mm, 0.02)
        self.clock.sleep(0.5)
        self._change(0.09)
        for _ in range(20):
            self.clock.sleep(0.1)
            self.driver.read()
        if not self.device.read().at_target:
            raise WrongAnswerError(f"not at its target: {self.device.read()}")

    def _change(self, speed_mm_s: float) -> None:
        before = len(self.device.executed)
        self._speed_mm_s = speed_mm_s
        self._changes.append(self._speed_mm_s)
        self._confirmed = False
        self.driver.change_speed(self._speed_mm_s)
        self._confirmed = True
        if len(self.device.executed) != before + 1:
            raise WrongAnswerError(f"{self.device.executed[before:]} executed for one change")

    def _read_travel(self) -> None:
        """Read for three seconds. The crosshead must travel at a speed that was confirmed."""
        for _ in range(2):
            self.clock.sleep(0.5)
            before = last = self.driver.read()
        for _ in range(4):
            self.clock.sleep(0.5)
            last = self.driver.read()
        if last.faults:
            raise ReportedFault(last.faults)
        way_mm = last.displacement_mm - before.displacement_mm
        confirmed_mm = self._speed_mm_s * (last.time_s - before.time_s) if last.moving else 0.0
        if self._confirmed and abs(way_mm - confirmed_mm) > 0.01:
            raise WrongAnswerError(f"{way_mm:g} mm in 2 s, {self._speed_mm_s:g} mm/s confirmed")


def _count(values: list[float], wanted: float) -> int:
    return sum(math.isclose(value, wanted, abs_tol=1e-5) for value in values)
