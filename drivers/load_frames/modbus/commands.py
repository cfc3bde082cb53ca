"""Send commands to a load frame on Modbus. Each command has a number. A hold command goes first."""

import contextlib
from collections.abc import Callable, Iterator, Mapping

from drivers.clock import Clock
from drivers.errors import DeviceTimeout, LinkLost
from drivers.interfaces import Setting
from drivers.lines.stop_deadline import StopTimes
from drivers.load_frames.modbus.bus.link import Overtaken
from drivers.load_frames.modbus.command_sequence import CommandSequence
from drivers.load_frames.modbus.hold import hold_until_confirmed
from drivers.load_frames.modbus.registers.map import RegisterMap
from drivers.load_frames.modbus.registers.mapped_device import MappedDevice
from drivers.load_frames.modbus.registers.registers import Number
from drivers.load_frames.modbus.sample_counter import Freshness
from drivers.load_frames.modbus.settings import ModbusLoadFrameSettings

# The connection for `hold` is used at this interval in s, because unused connections may be dropped.
HOLD_PROVEN_EVERY_S = 10.0
COMMAND_ATTEMPTS = 2
SUFFIXES = {"": "", "N": "_n", "mm": "_mm", "N/s": "_n_s", "mm/s": "_mm_s", "s": "_s"}


class LoadFrameCommands:
    """Sends commands to a load frame, and confirms each command by reading the machine's state.

    If the state of the machine is uncertain, every motion command is refused until a hold is confirmed.

    `clock` is the rig's clock. `work` and `safety` are two ways to the registers of the machine. Only `hold`
    uses `safety`, so that no other request delays a hold. `safety` has a connection of its own, or its
    requests go first on the shared connection.
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
            ("watchdog", blocks.watchdog, {"timeout": settings.watchdog_timeout_s}),
        ]
        for name, block, values in self._settings:
            work.set(block, values, f"set {name}")
        self._doubt = ""
        self._heartbeat = 0
        self._hold_proven_s = clock.now_s()

    def state(self, step: str) -> dict[str, Number]:
        """Read the state. Raise `DeviceFault` if the values are stale or the machine was restarted."""
        with self._doubting():
            values = self._work.read_state(step)
        try:
            self._freshness.check(int(values["sample"]), self._clock.now_s())
            self._sequence.check(int(values["executed"]))
        except ValueError as error:
            remedy = "hold, check the controller, then open the load frame again"
            raise self._work.fault(step, "a new reading", str(error), remedy) from error
        return values

    def read_settings(self, step: str) -> dict[str, Setting]:
        """Return the values of the blocks `limits` and `watchdog`, read back from the machine."""
        found: dict[str, Setting] = {}
        for _, block, values in self._settings:
            with self._doubting():
                read = self._work.read_valid(block, step, values)
            for name, value in read.items():
                own = "watchdog" if name == "timeout" else name
                found[f"{own}{SUFFIXES[block.registers[name].unit]}"] = value
        return found

    def stay_in_charge(self) -> None:
        """Reset the machine's watchdog, and check regularly that the connection for `hold` works."""
        self._heartbeat = (self._heartbeat + 1) % 2**16
        # ignore `Overtaken`, because a hold interrupted this request, and the machine then does not move
        with self._doubting(), contextlib.suppress(Overtaken):
            self._work.write(
                self._map.blocks.heartbeat,
                {"heartbeat": self._heartbeat},
                "feed the watchdog",
                harmless=True,
            )
        now_s = self._clock.now_s()
        if now_s - self._hold_proven_s > HOLD_PROVEN_EVERY_S and not self._safety.shares_link(self._work):
            with self._doubting():
                # read with an ordinary request, so that a hold does not wait for this check
                self._safety.unhurried().read_status("check the connection for hold")
            self._hold_proven_s = now_s

    @property
    def holds(self) -> int:
        """Number of holds that were requested so far."""
        return self._sequence.holds

    def distrust(self, doubt: str) -> None:
        """Refuse every motion until a hold is confirmed. `doubt` says why."""
        self._doubt = doubt

    def give(
        self,
        step: str,
        command: int,
        values: Mapping[str, float],
        permit: Callable[[dict[str, Number]], None] = lambda state: None,
    ) -> dict[str, Number]:
        """Send one command. Check by its sequence number that the machine executed and accepted it.

        `permit` is called with the state before the command, and may raise an error to prevent it. Return the
        state after the command.
        """
        if self._doubt:
            remedy = "call for a hold, then look at the specimen"
            raise self._work.fault(step, "a machine in a known state", self._doubt, remedy)
        holds = self._sequence.holds
        # read the state first, in order to refuse a motion if the machine cannot measure or was restarted
        permit(self.state(step))
        with self._doubting():
            self._refuse_lost_settings(step)
        self.stay_in_charge()
        overtaken = self._work.fault(step, "no hold meanwhile", "a hold", "repeat the command if needed")
        sequence = self._sequence.draw_unless_held(holds, overtaken)
        for _ in range(COMMAND_ATTEMPTS):
            # ignore a lost answer, because the state that is read next shows whether the command arrived
            with contextlib.suppress(DeviceTimeout, LinkLost):
                self._write(self._work, command, values, sequence)
            state = self.state(step)
            if state["executed"] == sequence:
                break
            if self._sequence.holds != holds:
                raise overtaken
        else:
            # from now on refuse motions, because the command may still arrive at the machine
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
        return state

    def hold(self) -> None:
        """Repeat the hold command until the machine confirms it. Raise `DeviceTimeout` at the deadline."""
        self._sequence.begin_hold()
        self._doubt = self._doubt or "a hold that was not confirmed"
        hold_until_confirmed(self._safety, self._map, self._sequence, self._hold_times, self._clock)
        self._doubt = ""

    @contextlib.contextmanager
    def _doubting(self) -> Iterator[None]:
        try:
            yield
        except (DeviceTimeout, LinkLost):
            self._doubt = "a link that was lost"
            raise

    def _refuse_lost_settings(self, step: str) -> None:
        """Raise `DeviceFault` if limits or watchdog time in the machine differ from those that this program
        wrote."""
        for name, block, values in self._settings:
            if not self._work.holds(block, values, step):
                remedy = "hold, find the program that changed it, then open the load frame again"
                raise self._work.fault(step, f"the {name} this program has set", "another setting", remedy)

    def _write(self, device: MappedDevice, command: int, values: Mapping[str, float], sequence: int) -> None:
        blocks = self._map.blocks
        if blocks.setpoints is not None:
            if values:
                device.set(blocks.setpoints, values, "write set points")
            values = {}
        device.write(blocks.command, {**values, "command": command, "sequence": sequence}, "send a command")
