"""Prepare the rig before the grid images, before the reference images, and before a run is continued."""

from collections.abc import Callable
from dataclasses import dataclass

from drivers.interfaces import OperatorAction
from rig.engine.devices import Devices
from rig.engine.look import Unloaded
from rig.engine.monitor import Monitor
from rig.engine.watch import Watch
from rig.protocol.conditions import Conditions, Zeroing
from rig.protocol.step import ProtocolStep, Reading


@dataclass(frozen=True)
class Actions:
    """Functions of the engine that `Preparation` needs.

    Attributes
    ----------
    read : callable
        Reads stage and load frame, checks the limits, and returns the reading.
    wait : callable
        Waits until a reading meets a condition. The arguments are two texts for error messages (the action
        and the expected result) and the condition.
    ask : callable
        Asks the operator for an action, and makes sure that nothing moves until the answer.
    log : callable
        Records a message.
    moves : callable
        Records that a device may move from now on.
    """

    read: Callable[[], Reading]
    wait: Callable[[str, str, Callable[[Reading], bool]], Reading]
    ask: Callable[[OperatorAction], None]
    log: Callable[[str], None]
    moves: Callable[[], None]


@dataclass(frozen=True)
class Preparation:
    """Prepares the rig as the conditions of a protocol require.

    `unloaded` gives the load up to which a specimen counts as unloaded, or is None without a load frame.
    """

    conditions: Conditions
    devices: Devices
    monitor: Monitor
    watch: Watch
    actions: Actions
    unloaded: Unloaded | None = None

    def for_grid(self, step: ProtocolStep) -> None:
        """Check that the specimen is unloaded, turn the stage to 0 degrees, and ask for the grid."""
        reading = self.actions.read()
        if self.unloaded is not None:
            self.unloaded.require(reading, f"{step}, before the grid is attached")
        if self.conditions.zero_tolerance_deg is not None:
            self._bring_to_zero(self.conditions.zero_tolerance_deg)
        self.actions.ask(OperatorAction.ATTACH_GRID)

    def for_reference(self, step: ProtocolStep) -> None:
        """Ask the operator to remove the grid, and set load and displacement to zero."""
        self.actions.ask(OperatorAction.REMOVE_GRID)
        if self.conditions.zeroing is not None:
            self._zero_load_frame(self.conditions.zeroing, step)

    def to_go_on(self) -> None:
        """Prepare a run that is continued: home the stage, and ask whether the specimen is untouched.

        Load and displacement are not set to zero again, because the specimen may be loaded.
        """
        self.actions.read()
        if self.conditions.zero_tolerance_deg is not None:
            self._home()
        if self.conditions.zeroing is not None:
            self.actions.ask(OperatorAction.GO_ON)

    def _home(self) -> None:
        assert self.devices.stage is not None  # `require_devices` has checked this
        if not self.monitor.homed:
            self.actions.log("stage: home")
            self.actions.moves()
            self.devices.stage.home()
            self.actions.wait("homing the stage", "the reference position", lambda _: self.monitor.homed)

    def _bring_to_zero(self, tolerance_deg: float) -> None:
        self._home()
        assert self.devices.stage is not None  # `require_devices` has checked this
        self.actions.moves()
        self.devices.stage.move_to(0.0)
        self.actions.wait("moving to 0 deg", "0 deg", lambda reading: abs(reading.angle_deg) <= tolerance_deg)

    def _zero_load_frame(self, zeroing: Zeroing, step: ProtocolStep) -> None:
        assert self.devices.load_frame is not None  # `require_devices` has checked this
        reading = self.actions.read()
        if self.unloaded is not None:
            self.unloaded.require(reading, f"{step}, zeroing the load frame")
        self.actions.log(f"load frame: zero at {reading.load_n:.1f} N, {reading.displacement_mm:.4f} mm")
        self.devices.load_frame.tare()
        self.watch.tared()
        self.actions.wait("zeroing the load frame", "load and displacement of zero", zeroing.is_zero)
