"""A load frame on Modbus whose register map has a command that changes the speed of a motion."""

import math
from typing import Any

from drivers.interfaces import LoadFrameState
from drivers.lines.call_time import one_call
from drivers.load_frames.modbus.frame import SET_SPEED, ModbusLoadFrame
from drivers.load_frames.modbus.registers.registers import Number
from drivers.load_frames.travel import Travel

_EXACT = 1e-6


class ModbusSpeedFrame(ModbusLoadFrame):
    """A `ModbusLoadFrame` that also has the method of `drivers.interfaces.ChangesSpeed`."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._travel = Travel()
        self._holds = 0

    @one_call
    def read(self) -> LoadFrameState:
        """Read as `ModbusLoadFrame.read`, and compare the travel with the last confirmed speeds.

        Raise `DeviceFault` if the crosshead does not have the speed that the machine confirmed. Every later
        motion is then refused until a `hold` is confirmed.
        """
        asked_s = self._clock.now_s()
        state = super().read()
        if not state.moving or state.holding or self._commands.holds != self._holds:
            self._travel.end()
        try:
            self._travel.check(state.displacement_mm, asked_s, state.time_s)
        except ValueError as error:
            self._commands.distrust("a crosshead with another speed than confirmed")
            remedy = "hold, then check the drive and its speed limits"
            raise self._work.fault("read", "the confirmed speed", str(error), remedy) from error
        return state

    @one_call
    def go_to_load(self, load_n: float, rate_n_s: float) -> None:
        """Start a ramp as `ModbusLoadFrame.go_to_load`; the speed of a ramp cannot be changed."""
        self._travel.end()
        super().go_to_load(load_n, rate_n_s)

    @one_call
    def go_to_displacement(self, displacement_mm: float, speed_mm_s: float) -> None:
        """Start a move as `ModbusLoadFrame.go_to_displacement`; its speed can be changed."""
        self._travel.end()
        self._holds = self._commands.holds
        super().go_to_displacement(displacement_mm, speed_mm_s)
        self._travel.begin(displacement_mm, speed_mm_s)

    @one_call
    def change_speed(self, speed_mm_s: float) -> None:
        """Change the speed of the present motion to a displacement. It never starts a motion.

        Raise `DeviceFault` if the speed is beyond the limits, if this program began no such motion, if the
        motion is over or a hold was requested since it began, or if the machine refuses the command or reads
        back another speed.
        """
        step = f"change the speed to {speed_mm_s:g} mm/s"
        self._refuse_rate(step, speed_mm_s, self.limits.speed_max_mm_s, "mm/s")
        command = self._map.commands.change_speed
        assert command is not None

        def permit(values: dict[str, Number]) -> None:
            self._refuse_without_motion(step, values)

        permit({})
        asked_s = self._clock.now_s()
        values = self._commands.give(step, command, {"speed": speed_mm_s}, permit)
        if not self._moves(values):
            # the target was reached meanwhile
            return
        self._refuse_other_speed(step, speed_mm_s, values)
        self._travel.change(speed_mm_s, float(values["displacement"]), asked_s, self._clock.now_s())

    def _moves(self, values: dict[str, Number]) -> bool:
        bits, status = int(values["status"]), self._map.status
        return bool(bits >> status.moving & 1) and not bits >> status.hold & 1

    def _refuse_without_motion(self, step: str, values: dict[str, Number]) -> None:
        """Raise `DeviceFault` without a motion of this program, or if the machine's status says so."""
        got = ""
        if not self._travel.begun:
            got = "no such motion of this program"
        elif self._commands.holds != self._holds:
            got = "a hold since it began"
        elif values and not self._moves(values):
            got = "a crosshead that stands or holds"
        if got:
            remedy = "change the speed only during a motion to a displacement"
            raise self._work.fault(step, "a motion to a displacement", got, remedy)

    def _refuse_other_speed(self, step: str, speed_mm_s: float, values: dict[str, Number]) -> None:
        found = float(values.get(SET_SPEED, math.nan))
        blocks = self._map.blocks
        command = (blocks.setpoints or blocks.command).registers["speed"]
        home = blocks.status if blocks.status and SET_SPEED in blocks.status.registers else blocks.state
        places = [command, *(each for name, each in home.registers.items() if name == SET_SPEED)]
        steps_mm_s = sum(0.5 * each.scale for each in places if each.type != "f32")
        if math.isnan(found) or abs(found - speed_mm_s) <= steps_mm_s + _EXACT * speed_mm_s:
            return
        self._commands.distrust("a speed that the machine did not take")
        expected, got = f"a set speed of {speed_mm_s:g} mm/s", f"{found:g} mm/s on reading back"
        raise self._work.fault(step, expected, got, "hold, then check the machine's own speed limits")
