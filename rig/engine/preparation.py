"""Prepare the rig before the grid images, before the reference images, and before a run is continued."""

import math

from drivers.interfaces import OperatorAction
from rig.engine.context import RunContext
from rig.engine.look import unloaded
from rig.engine.motion import Motion
from rig.errors import ProtocolError
from rig.protocol.conditions import Zeroing
from rig.protocol.step import ProtocolStep
from rig.recorder.records import OPERATOR_DONE


class Preparation:
    """Prepares the rig as the conditions of a protocol require.

    Parameters
    ----------
    run : RunContext
    motion : Motion

    Attributes
    ----------
    asking : bool
        True while the run waits for an answer from the operator. Any thread may read this attribute.
    """

    def __init__(self, run: RunContext, motion: Motion) -> None:
        self.asking = False
        self._run = run
        self._motion = motion
        self._conditions = run.protocol.conditions
        self._unloaded = unloaded(self._conditions, run.rig)

    def require_devices(self) -> None:
        """Raise `ProtocolError` if the rig lacks a device that the protocol moves."""
        for needed in sorted(self._conditions.devices):
            if getattr(self._run.rig, needed) is None:
                raise ProtocolError(
                    f"a {self._run.protocol.kind} protocol",
                    f"a [{needed}] in the rig file",
                    "none",
                    f"add a [{needed}], or run the protocol on a rig that has one",
                )

    def for_grid(self, step: ProtocolStep) -> None:
        """Check that the specimen is unloaded, turn the stage to 0 degrees, and ask for the grid."""
        reading = self._run.read()
        if self._unloaded is not None:
            self._unloaded.require(reading, f"{step}, before the grid is attached")
        if self._conditions.zero_tolerance_deg is not None:
            self._bring_to_zero(self._conditions.zero_tolerance_deg)
        self._ask(OperatorAction.ATTACH_GRID)

    def for_reference(self, step: ProtocolStep) -> None:
        """Ask the operator to remove the grid, and set load and displacement to zero."""
        self._ask(OperatorAction.REMOVE_GRID)
        if self._conditions.zeroing is not None:
            self._zero_load_frame(self._conditions.zeroing, step)

    def to_go_on(self) -> None:
        """Prepare a run that is continued: home the stage, and ask whether the specimen is untouched.

        Load and displacement are not set to zero again, because the specimen may be loaded.
        """
        self._run.read()
        if self._conditions.zero_tolerance_deg is not None:
            self._home()
        if self._conditions.zeroing is not None:
            self._ask(OperatorAction.GO_ON)

    def _ask(self, action: OperatorAction) -> None:
        """Ask the operator for an action. Make sure that nothing moves until the answer."""
        run = self._run
        self._motion.stand_still()
        run.log("info", f"operator: {action.value}")
        try:
            self.asking = True
            run.check_abort()
            run.devices.operator.perform(action)
            run.mark(OPERATOR_DONE)
        finally:
            self.asking = False

    def _home(self) -> None:
        stage = self._run.devices.stage
        assert stage is not None  # `require_devices` has checked this
        if not self._run.monitor.homed:
            self._run.log("info", "stage: home")
            self._run.may_move = True
            stage.do("home", stage.driver.home)
            self._motion.wait("homing the stage", "the reference position", lambda _: self._run.monitor.homed)

    def _bring_to_zero(self, tolerance_deg: float) -> None:
        self._home()
        self._run.may_move = True
        self._run.devices.go_to("rotation", 0.0, math.nan)
        self._motion.wait("moving to 0 deg", "0 deg", lambda reading: abs(reading.angle_deg) <= tolerance_deg)

    def _zero_load_frame(self, zeroing: Zeroing, step: ProtocolStep) -> None:
        frame = self._run.devices.load_frame
        assert frame is not None  # `require_devices` has checked this
        reading = self._run.read()
        if self._unloaded is not None:
            self._unloaded.require(reading, f"{step}, zeroing the load frame")
        self._run.log("info", f"load frame: zero at {reading.load_n:.1f} N, {reading.displacement_mm:.4f} mm")
        frame.do("tare", frame.driver.tare)
        self._run.watch.tared()
        self._motion.wait("zeroing the load frame", "load and displacement of zero", zeroing.is_zero)
