"""A tensile load frame on Modbus: readings, motions, hold and tare, as its register map describes them."""

import math

from drivers.errors import DeviceTimeout, LinkLost
from drivers.interfaces import DeviceInfo, LoadFrameLimits, LoadFrameState, OpenContext, Setting
from drivers.lines.call_time import CallTime, one_call
from drivers.lines.stop_deadline import StopTimes
from drivers.load_frames.modbus.commands import LoadFrameCommands
from drivers.load_frames.modbus.registers.map import RegisterMap
from drivers.load_frames.modbus.registers.mapped_device import MappedDevice
from drivers.load_frames.modbus.registers.registers import Number
from drivers.load_frames.modbus.settings import ModbusLoadFrameSettings

SET_SPEED = "set_speed"
"""Optional register of the state: the speed to which the present motion to a displacement is set."""


class ModbusLoadFrame:
    """A `LoadFrame` on Modbus. To construct this class, call `open_frame`.

    `work` and `safety` are described for `LoadFrameCommands`. `call_time` is the time left in the present
    call. The links use the same object.
    """

    info: DeviceInfo
    limits: LoadFrameLimits

    def __init__(
        self,
        settings: ModbusLoadFrameSettings,
        context: OpenContext,
        register_map: RegisterMap,
        work: MappedDevice,
        safety: MappedDevice,
        hold_times: StopTimes,
        call_time: CallTime,
    ) -> None:
        self._call_time = call_time
        self._clock = context.clock
        self._map = register_map
        self._work = work
        self._safety = safety
        identity = work.identify("identify")
        firmware = int(identity["firmware"])
        self.info = DeviceInfo(
            vendor=register_map.vendor,
            model=register_map.model,
            serial=str(identity["serial"]),
            firmware=f"{firmware >> 8}.{firmware & 0xFF}",
            simulated=settings.address.startswith("@"),
        )
        self._commands = LoadFrameCommands(settings, context.clock, register_map, work, safety, hold_times)
        # report the limits of the rig file, which the machine rounds to the resolution of its registers
        self.limits = settings.limits
        self._prove_way_for_hold(identity)

    @one_call
    def read(self) -> LoadFrameState:
        """Read the state of the machine, then reset the machine's watchdog.

        Raise `DeviceFault` if the sample counter does not increase, a value is impossible, the revision of
        the machine's register map is different, or the machine was restarted, and `DeviceTimeout` or
        `LinkLost` if no answer came. Every later motion is refused until a `hold` is confirmed.
        """
        values = self._commands.state("read")
        read_s = self._clock.now_s()
        self._commands.stay_in_charge()
        bits = int(values["status"])
        status = self._map.status
        faults = [name for name, bit in status.faults.items() if bits >> bit & 1]
        code = int(values["fault"])
        if code:
            faults.insert(0, self._map.fault_codes.get(str(code), f"fault {code}"))
        return LoadFrameState(
            load_n=float(values["load"]),
            displacement_mm=float(values["displacement"]),
            moving=bool(bits >> status.moving & 1),
            at_target=bool(bits >> status.at_target & 1),
            holding=bool(bits >> status.hold & 1),
            sample=int(values["sample"]),
            faults=tuple(dict.fromkeys(faults)),
            time_s=read_s,
            speed_mm_s=float(values.get(SET_SPEED, math.nan)),
        )

    def read_settings(self) -> dict[str, Setting]:
        """Read back from the machine all registers of the register map's blocks `limits` and `watchdog`.

        Raise `DeviceFault` if a limit or the watchdog time has no valid value. May also raise `DeviceTimeout`
        or `LinkLost`.
        """
        return {**self._commands.read_settings("read settings"), "firmware": self.info.firmware}

    @one_call
    def go_to_load(self, load_n: float, rate_n_s: float) -> None:
        """Start a ramp to a load, in N. Raise `DeviceFault` if the load or the rate exceeds the limits."""
        limits = self.limits
        step = f"go to {load_n:g} N at {rate_n_s:g} N/s"
        self._refuse_outside(step, load_n, limits.load_min_n, limits.load_max_n, "N")
        self._refuse_rate(step, rate_n_s, limits.load_rate_max_n_s, "N/s")
        self._commands.give(step, self._map.commands.go_to_load, {"load": load_n, "load_rate": rate_n_s})

    @one_call
    def go_to_displacement(self, displacement_mm: float, speed_mm_s: float) -> None:
        """Start a move to a crosshead position, in mm. Raise `DeviceFault` if it is beyond the limits."""
        limits = self.limits
        step = f"go to {displacement_mm:g} mm at {speed_mm_s:g} mm/s"
        self._refuse_outside(
            step, displacement_mm, limits.displacement_min_mm, limits.displacement_max_mm, "mm"
        )
        self._refuse_rate(step, speed_mm_s, limits.speed_max_mm_s, "mm/s")
        values = {"displacement": displacement_mm, "speed": speed_mm_s}
        self._commands.give(step, self._map.commands.go_to_displacement, values)

    @one_call
    def tare(self) -> None:
        """Set the zero points of load and displacement to the present state. Refuse this during a motion."""
        self._commands.give("tare", self._map.commands.tare, {})

    def hold(self) -> None:
        """Send the hold command ahead of all other requests, and repeat it until the machine confirms it.

        A motion command that another thread has not yet sent is cancelled. The machine ignores an older
        motion command that arrives after the hold. Raise `DeviceTimeout` if the machine does not confirm the
        hold before the deadline of the hold.
        """
        self._commands.hold()

    def close(self) -> None:
        """Release all connections without stopping the machine. A repeated call has no effect."""
        self._work.close()
        self._safety.close()

    def _prove_way_for_hold(self, identity: dict[str, Number]) -> None:
        step, alone = "check the connection for hold", "set connections to the number that the machine takes"
        try:
            found = self._safety.identify(step)
        except (DeviceTimeout, LinkLost) as error:
            if self._safety.shares_link(self._work):
                raise
            raise type(error)(error.device, error.step, error.expected, error.got, alone) from error
        if found != identity:
            remedy = "check that one machine only has this address"
            raise self._safety.fault(step, f"the machine {identity}", f"{found}", remedy)

    def _refuse_outside(self, step: str, value: float, low: float, high: float, unit: str) -> None:
        if not (math.isfinite(value) and low <= value <= high):
            expected = f"a target from {low:g} to {high:g} {unit}"
            raise self._work.fault(step, expected, f"{value:g} {unit}", "correct the protocol")

    def _refuse_rate(self, step: str, rate: float, greatest: float, unit: str) -> None:
        if not 0 < rate <= greatest:
            expected = f"a rate above 0 up to {greatest:g} {unit}"
            raise self._work.fault(step, expected, f"{rate:g} {unit}", "correct the protocol")
