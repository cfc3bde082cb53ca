"""Commands to a load frame on Modbus: each confirmed by its number, and a hold that precedes them."""

import contextlib
from collections.abc import Iterator, Mapping

from drivers.clock import Clock
from drivers.errors import DeviceError, DeviceTimeout, LinkLost
from drivers.lines.stop_deadline import StopDeadline, StopTimes
from drivers.load_frames.modbus.bus.link import Overtaken
from drivers.load_frames.modbus.command_sequence import CommandSequence
from drivers.load_frames.modbus.registers.map import RegisterMap
from drivers.load_frames.modbus.registers.mapped_device import MappedDevice
from drivers.load_frames.modbus.registers.registers import Number
from drivers.load_frames.modbus.sample_counter import Freshness
from drivers.load_frames.modbus.settings import ModbusLoadFrameSettings

# Network switches and machines drop unused connections, some without notice.
HOLD_PROVEN_EVERY_S = 10.0
COMMAND_ATTEMPTS = 2


class LoadFrameCommands:
    """Commands to a load frame, and the readings that confirm them.

    If the state of the machine is uncertain, every motion command is refused until a hold is confirmed.

    Parameters
    ----------
    settings : ModbusLoadFrameSettings
    clock : Clock
        The rig's.
    register_map : RegisterMap
    work, safety : MappedDevice
        Both reach the same machine. `safety` is for `hold`, which nothing else may delay: it has its own
        connection or, if there is only one connection, priority on it.
    hold_times : StopTimes
    """

    def __init__(
        self,
        settings: ModbusLoadFrameSettings,
        clock: Clock,
        register_map: RegisterMap,
        work: MappedDevice,
        safety: MappedDevice,
        hold_times: StopTimes,
    ) -> None:
        self._clock = clock
        self._hold_times = hold_times
        self._map = register_map
        self._work = work
        self._safety = safety
        blocks = register_map.blocks
        self._freshness = Freshness(settings.stale_after_s, 2 ** (16 * blocks.state.registers["sample"].size))
        self._sequence = CommandSequence(int(work.read_state("read the state")["executed"]))
        self._settings = [
            ("limits", blocks.limits, settings.limits_by_register),
            ("watchdog", blocks.watchdog, {"timeout": settings.watchdog_s}),
        ]
        for name, block, values in self._settings:
            work.set(block, values, f"set {name}")
        self._doubt = ""
        self._heartbeat = 0
        self._hold_proven_s = clock.now_s()

    def state(self, step: str) -> dict[str, Number]:
        """Read the state; `DeviceFault` if it is stale or impossible, or the machine was restarted."""
        with self._doubting():
            values = self._work.read_state(step)
        try:
            self._freshness.check(int(values["sample"]), self._clock.now_s())
            self._sequence.check(int(values["executed"]))
        except ValueError as error:
            remedy = "hold, check the controller, then open the load frame again"
            raise self._work.fault(step, "a new reading", str(error), remedy) from error
        return values

    def stay_in_charge(self) -> None:
        """Feed the machine's watchdog, and check regularly that the connection for `hold` works."""
        self._heartbeat = (self._heartbeat + 1) % 2**16
        with self._doubting(), contextlib.suppress(Overtaken):  # overtaken by a hold: nothing moves
            self._work.write(self._map.blocks.heartbeat, {"heartbeat": self._heartbeat}, "feed the watchdog")
        now_s = self._clock.now_s()
        if now_s - self._hold_proven_s > HOLD_PROVEN_EVERY_S and not self._safety.shares_link(self._work):
            with self._doubting():
                # not urgent, so that a hold does not wait for this check
                self._safety.unhurried().read_status("prove the way for hold")
            self._hold_proven_s = now_s

    def give(self, step: str, command: int, values: Mapping[str, float]) -> None:
        """Give one command and confirm by its sequence number that it was executed once and accepted."""
        if self._doubt:
            remedy = "call for a hold, then look at the specimen"
            raise self._work.fault(step, "a machine in a known state", self._doubt, remedy)
        holds = self._sequence.holds
        # refuse motion before the command if the machine cannot measure or was restarted
        self.state(step)
        with self._doubting():
            self._refuse_lost_settings(step)
        self.stay_in_charge()
        overtaken = self._work.fault(step, "no hold meanwhile", "a hold", "command it again if it is wanted")
        sequence = self._sequence.draw_unless_held(holds, overtaken)
        for _ in range(COMMAND_ATTEMPTS):
            # a lost answer leaves open whether the command arrived: the state read next shows it
            with contextlib.suppress(DeviceTimeout, LinkLost):
                self._write(self._work, command, values, sequence)
            state = self.state(step)
            if state["executed"] == sequence:
                break
            if self._sequence.holds != holds:
                raise overtaken
        else:
            # the command may still be on its way
            self._doubt = "a command that was not confirmed"
            raise DeviceTimeout(
                self._work.name,
                step,
                f"command {sequence} executed",
                f"command {state['executed']:g} as the last one",
                "check that nothing else commands the machine",
            )
        if state["result"]:
            reason = self._map.results.get(f"{state['result']:g}", f"result {state['result']:g}")
            remedy = "correct the protocol or clear the machine's fault"
            raise self._work.fault(step, "acceptance", reason, remedy)

    def hold(self) -> None:
        """Stop and hold position now; repeated until it is confirmed, `DeviceTimeout` at the deadline."""
        self._sequence.begin_hold()
        self._doubt = self._doubt or "a hold that was not confirmed"
        deadline = StopDeadline(self._clock, self._hold_times.deadline_s)
        got = "silence"
        while not deadline.passed:
            try:
                sequence = self._sequence.draw()
                self._write(self._safety, self._map.commands.hold, {}, sequence)
                # without load and displacement: a broken load cell must not prevent the confirmation
                values = self._safety.read_status("hold")
                self._sequence.follow(int(values["executed"]))
                status, bits = self._map.status, int(values["status"])
                # the status bit is not enough: only an executed hold invalidates a motion command on its way
                executed = values["executed"] == sequence
                if executed and bits >> status.hold & 1 and not bits >> status.moving & 1:
                    self._doubt = ""
                    return
                got = "a crosshead in motion" if executed else "a hold that was not executed"
            except DeviceError as error:
                got = f"{error.got} instead of {error.expected}"
            self._clock.sleep(self._hold_times.poll_s)
        raise DeviceTimeout(self._work.name, "hold", "a confirmed hold", got, "press the emergency stop")

    @contextlib.contextmanager
    def _doubting(self) -> Iterator[None]:
        try:
            yield
        except (DeviceTimeout, LinkLost):
            self._doubt = "a link that was lost"
            raise

    def _refuse_lost_settings(self, step: str) -> None:
        """Refuse a machine whose settings differ from those this program wrote."""
        for name, block, values in self._settings:
            if not self._work.holds(block, values, step):
                remedy = "hold, see who else sets the machine, then open the load frame again"
                raise self._work.fault(step, f"the {name} this program has set", "another setting", remedy)

    def _write(self, device: MappedDevice, command: int, values: Mapping[str, float], sequence: int) -> None:
        blocks = self._map.blocks
        if blocks.setpoints is not None:
            if values:
                device.set(blocks.setpoints, values, "write set points")
            values = {}
        device.write(blocks.command, {**values, "command": command, "sequence": sequence}, "send a command")
