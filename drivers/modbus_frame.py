"""Tensile load frame on Modbus TCP or RTU, described by a register map."""

import contextlib
import math
from collections.abc import Mapping

from drivers.address import resolve_address
from drivers.command_sequence import CommandSequence
from drivers.errors import DeviceError, DeviceTimeout, LinkLost
from drivers.freshness import Freshness
from drivers.interfaces import DeviceInfo, FrameLimits, FrameState, OpenContext
from drivers.mapped_device import MappedDevice
from drivers.modbus_frame_settings import ModbusFrameSettings
from drivers.modbus_link import ModbusLink, Overtaken
from drivers.patience import Patience
from drivers.register_map import RegisterMap, load_map
from drivers.registers import Number
from drivers.registry import DriverSpec

HOLD_PATIENCE_S = 5.0
HOLD_POLL_S = 0.02
COMMAND_ATTEMPTS = 2


class ModbusFrame:
    """A `LoadFrame` on Modbus; construct it with `open_frame`.

    Parameters
    ----------
    settings : ModbusFrameSettings
    context : OpenContext
    register_map : RegisterMap
    work, safety : MappedDevice
        Two ways to the same machine, the second for `hold`, which nothing else may delay: a connection of
        its own, or the right to go first where there is only one.
    """

    info: DeviceInfo
    limits: FrameLimits

    def __init__(
        self,
        settings: ModbusFrameSettings,
        context: OpenContext,
        register_map: RegisterMap,
        work: MappedDevice,
        safety: MappedDevice,
    ) -> None:
        self._clock = context.clock
        self._map = register_map
        self._work = work
        self._safety = safety
        blocks = register_map.blocks
        self._freshness = Freshness(settings.stale_after_s, 2 ** (16 * blocks.state.registers["sample"].size))
        self._link_was_lost = False
        self._heartbeat = 0
        self._sequence = CommandSequence(int(work.read_state("identify")["executed"]))
        identity = work.read(blocks.identity, "identify")
        firmware = int(identity["firmware"])
        self.info = DeviceInfo(
            vendor=register_map.vendor,
            model=register_map.model,
            serial=str(identity["serial"]),
            firmware=f"{firmware >> 8}.{firmware & 0xFF}",
            simulated=settings.address.startswith("@"),
        )
        self._settings = [
            ("limits", blocks.limits, settings.limits_by_register),
            ("watchdog", blocks.watchdog, {"timeout": settings.watchdog_s}),
        ]
        for name, block, values in self._settings:
            work.set(block, values, f"set {name}")
        # the machine has them word for word: what differs is only the rounding of its registers
        self.limits = settings.limits
        safety.read_state("open the connection for hold")

    def read(self) -> FrameState:
        """Read the state in one request, then feed the machine's watchdog.

        Raises
        ------
        DeviceFault
            If the readings are stale, impossible or of another register map, or the machine was restarted.
        DeviceTimeout, LinkLost
            If no answer came. After that motion is refused until `hold` was confirmed.
        """
        values = self._fresh_state("read")
        self._feed_watchdog()
        bits = int(values["status"])
        status = self._map.status
        faults = [name for name, bit in status.faults.items() if bits >> bit & 1]
        code = int(values["fault"])
        if code:
            faults.insert(0, self._map.fault_codes.get(str(code), f"fault {code}"))
        return FrameState(
            load_n=float(values["load"]),
            displacement_mm=float(values["displacement"]),
            moving=bool(bits >> status.moving & 1),
            at_target=bool(bits >> status.at_target & 1),
            holding=bool(bits >> status.hold & 1),
            sample=int(values["sample"]),
            faults=tuple(dict.fromkeys(faults)),
            time_s=self._clock.now_s(),
        )

    def go_to_load(self, load_n: float, rate_n_s: float) -> None:
        """Begin to approach a load along a ramp; `DeviceFault` beyond the limits."""
        limits = self.limits
        step = f"go to {load_n:g} N at {rate_n_s:g} N/s"
        self._refuse_outside(step, load_n, limits.load_min_n, limits.load_max_n, "N")
        self._refuse_rate(step, rate_n_s, limits.load_rate_max_n_s, "N/s")
        self._command(step, self._map.commands.go_to_load, {"load": load_n, "load_rate": rate_n_s})

    def go_to_displacement(self, displacement_mm: float, speed_mm_s: float) -> None:
        """Begin to approach a crosshead position at constant speed; `DeviceFault` beyond the limits."""
        limits = self.limits
        step = f"go to {displacement_mm:g} mm at {speed_mm_s:g} mm/s"
        self._refuse_outside(
            step, displacement_mm, limits.displacement_min_mm, limits.displacement_max_mm, "mm"
        )
        self._refuse_rate(step, speed_mm_s, limits.speed_max_mm_s, "mm/s")
        self._command(
            step,
            self._map.commands.go_to_displacement,
            {"displacement": displacement_mm, "speed": speed_mm_s},
        )

    def tare(self) -> None:
        """Make the present load and displacement the zero; `DeviceFault` while moving."""
        self._command("tare", self._map.commands.tare, {})

    def hold(self) -> None:
        """Stop and hold position now, on a connection of its own; repeated until the machine confirms.

        A motion command that another thread has not yet sent is kept back, and one that is overtaken is not
        executed by the machine.

        Raises
        ------
        DeviceTimeout
            If the machine does not confirm within 5 s.
        """
        self._sequence.begin_hold()
        patience = Patience(self._clock, HOLD_PATIENCE_S)
        got = "silence"
        while not patience.exhausted:
            try:
                sequence = self._sequence.draw()
                self._write_command(self._safety, self._map.commands.hold, {}, sequence)
                # a broken load cell must not keep the machine from confirming
                values = self._safety.read_status("hold")
                self._sequence.follow(int(values["executed"]))
                status, bits = self._map.status, int(values["status"])
                # that it holds is not enough: only an executed hold makes a motion command under way too old
                executed = values["executed"] == sequence
                if executed and bits >> status.hold & 1 and not bits >> status.moving & 1:
                    self._link_was_lost = False
                    return
                got = "a crosshead in motion" if executed else "a hold that was not executed"
            except DeviceError as error:
                got = f"{error.got} instead of {error.expected}"
            self._clock.sleep(HOLD_POLL_S)
        raise DeviceTimeout(
            self._work.name, "hold", expected="a confirmed hold", got=got, remedy="press the emergency stop"
        )

    def close(self) -> None:
        """Release both connections; harmless when repeated. It does not stop anything."""
        self._work.close()
        self._safety.close()

    def _feed_watchdog(self) -> None:
        self._heartbeat = (self._heartbeat + 1) % 2**16
        try:
            self._work.write(self._map.blocks.heartbeat, {"heartbeat": self._heartbeat}, "feed the watchdog")
        except Overtaken:
            return  # by a hold: nothing moves that the watchdog would have to guard
        except (DeviceTimeout, LinkLost):
            self._link_was_lost = True
            raise

    def _command(self, step: str, command: int, values: Mapping[str, float]) -> None:
        """Give one command and prove by its sequence number that it was executed, once, and accepted."""
        if self._link_was_lost:
            raise self._work.fault(
                step, "an unbroken link", "a link that was lost", "call for a hold, then look at the specimen"
            )
        holds = self._sequence.holds
        self._refuse_lost_settings(step)
        overtaken = self._work.fault(step, "no hold meanwhile", "a hold", "command it again if it is wanted")
        sequence = self._sequence.draw_unless_held(holds, overtaken)
        for attempt in range(COMMAND_ATTEMPTS):
            # after a lost answer nobody knows whether the command arrived: the state read next tells
            with contextlib.suppress(DeviceTimeout, LinkLost):
                self._write_command(self._work, command, values, sequence)
            state = self._fresh_state(step)
            if state["executed"] == sequence:
                break
            if self._sequence.holds != holds:
                raise overtaken
            if attempt == COMMAND_ATTEMPTS - 1:
                raise DeviceTimeout(
                    self._work.name,
                    step,
                    expected=f"command {sequence} executed",
                    got=f"command {state['executed']:g} as the last one",
                    remedy="check that nothing else commands the machine",
                )
        if state["result"]:
            reason = self._map.results.get(f"{state['result']:g}", f"result {state['result']:g}")
            raise self._work.fault(
                step, "acceptance", reason, "correct the protocol or clear the machine's fault"
            )

    def _refuse_lost_settings(self, step: str) -> None:
        """A machine that somebody else has set, or that forgot its settings, is not what was opened."""
        for name, block, values in self._settings:
            if not self._work.holds(block, values, step):
                # a restart explains it better
                self._fresh_state(step)
                remedy = "hold, see who else sets the machine, then open the frame again"
                raise self._work.fault(step, f"the {name} this program has set", "another setting", remedy)

    def _write_command(
        self, device: MappedDevice, command: int, values: Mapping[str, float], sequence: int
    ) -> None:
        blocks = self._map.blocks
        if blocks.setpoints is not None:
            if values:
                device.write_checked(blocks.setpoints, values, "write set points")
            values = {}
        device.write(blocks.command, {**values, "command": command, "sequence": sequence}, "send a command")

    def _fresh_state(self, step: str) -> dict[str, Number]:
        try:
            values = self._work.read_state(step)
        except (DeviceTimeout, LinkLost):
            self._link_was_lost = True
            raise
        try:
            self._freshness.check(int(values["sample"]), self._clock.now_s())
            self._sequence.check(int(values["executed"]))
        except ValueError as error:
            remedy = "hold, check the controller, then open the frame again"
            raise self._work.fault(step, "a new reading", str(error), remedy) from error
        return values

    def _refuse_outside(self, step: str, value: float, low: float, high: float, unit: str) -> None:
        if not (math.isfinite(value) and low <= value <= high):
            expected = f"a target from {low:g} to {high:g} {unit}"
            raise self._work.fault(step, expected, f"{value:g} {unit}", "correct the protocol")

    def _refuse_rate(self, step: str, rate: float, greatest: float, unit: str) -> None:
        if not 0 < rate <= greatest:
            expected = f"a rate above 0 up to {greatest:g} {unit}"
            raise self._work.fault(step, expected, f"{rate:g} {unit}", "correct the protocol")


def open_frame(settings: ModbusFrameSettings, context: OpenContext) -> ModbusFrame:
    """Connect, identify the machine, write its limits and read them back; nothing moves.

    Raises
    ------
    DeviceError
        If the machine does not answer, or a limit is not taken.
    ConfigurationError
        If the register map has mistakes.
    """
    register_map = load_map(settings.map)
    place = settings.place(resolve_address(settings.address, context))
    shared = place.rtu or settings.connections == 1
    links = [
        ModbusLink(f"{context.name} ({place.text})", place, settings.unit, settings.reply_timeout_s)
        for _ in range(1 if shared else 2)
    ]
    identity = register_map.blocks.identity
    for link in links:
        link.prove_by(identity.table, identity.address, identity.count)
    work, safety = MappedDevice(links[0], register_map), MappedDevice(links[-1], register_map, urgent=True)
    try:
        return ModbusFrame(settings, context, register_map, work, safety)
    except DeviceError:
        work.close()
        safety.close()
        raise


SPEC = DriverSpec(kind="load_frame", settings=ModbusFrameSettings, open=open_frame)
