"""Prepare the rig before the grid images, before the reference images, and before a run is continued."""

import math

from drivers.interfaces import OperatorAction
from rig.devices import Rig
from rig.engine.context import RunContext
from rig.engine.motion import RunMotion
from rig.errors import LimitViolation, ProtocolError
from rig.protocol.conditions import Conditions, Zeroing
from rig.protocol.step import ProtocolStep, RigReading
from rig.recorder.records import OPERATOR_DONE

UNLOADED_SHARE = 0.01
"""An unloaded load cell may show this fraction of the largest load, from zero error and weight of grips."""


class Preparation:
    """Prepares the rig as the conditions of a protocol require.

    `asking` is True while the run waits for an answer from the operator. Any thread may read this attribute.
    """

    def __init__(self, run: RunContext, motion: RunMotion) -> None:
        self.asking = False
        self._has_grid = False
        self._run = run
        self._motion = motion
        self._conditions = run.protocol.conditions
        self._unloaded = _unloaded(self._conditions, run.rig)

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
        self._require_unloaded(reading, f"{step}, before the grid is attached")
        if self._conditions.zero_tolerance_deg is not None:
            self._bring_to_zero(self._conditions.zero_tolerance_deg)
        self._ask(OperatorAction.ATTACH_GRID)
        self._has_grid = True

    def for_reference(self, step: ProtocolStep) -> None:
        """Ask the operator to remove the grid, and set load and displacement to zero."""
        if self._has_grid or self._run.protocol.kind != "acquire":
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

    def _require_unloaded(self, reading: RigReading, step: str) -> None:
        """Raise `LimitViolation` if the specimen is loaded, for example after a failed run.

        The operator must not touch a loaded specimen, and its load must not be set to zero.
        """
        if self._unloaded is None:
            return
        most_n, remedy = self._unloaded
        if not abs(reading.load_n) <= most_n:
            raise LimitViolation(
                step,
                f"a load within {most_n:g} N",
                f"{reading.load_n:.1f} N",
                "unload the specimen with rig unload, as a real load must not be zeroed; if the specimen is "
                f"unloaded, {remedy.format(load_n=abs(reading.load_n))}",
            )

    def _home(self) -> None:
        stage = self._run.devices.stage
        assert stage is not None  # `require_devices` has checked this
        if not self._run.monitor.homed:
            self._run.log("info", "stage: home")
            driver = stage.driver

            def begin(_: float) -> None:
                self._run.may_move = True
                stage.do("home", driver.home)

            begin(0.0)
            self._motion.wait(
                "homing the stage", "the reference position", lambda _: self._run.monitor.homed, again=begin
            )

    def _bring_to_zero(self, tolerance_deg: float) -> None:
        self._home()

        def begin(_: float) -> None:
            self._run.may_move = True
            self._run.devices.go_to("rotation", 0.0, math.nan)

        begin(0.0)
        self._motion.wait(
            "moving to 0 deg", "0 deg", lambda reading: abs(reading.angle_deg) <= tolerance_deg, again=begin
        )

    def _zero_load_frame(self, zeroing: Zeroing, step: ProtocolStep) -> None:
        frame = self._run.devices.load_frame
        assert frame is not None  # `require_devices` has checked this
        reading = self._run.read()
        self._require_unloaded(reading, f"{step}, zeroing the load frame")
        self._run.log("info", f"load frame: zero at {reading.load_n:.1f} N, {reading.displacement_mm:.4f} mm")
        frame.do("tare", frame.driver.tare)
        self._run.watch.tared()
        self._motion.wait("zeroing the load frame", "load and displacement of zero", zeroing.is_zero)


def _unloaded(conditions: Conditions, rig: Rig) -> tuple[float, str] | None:
    """Return the largest load in N of an unloaded specimen, and what to do if a larger one is only an error.

    The load comes from the protocol if the protocol pulls the specimen, and otherwise from the rig.
    """
    if (zeroing := conditions.zeroing) is not None:
        return zeroing.tare_max_n, (
            f"raise {zeroing.key} above {{load_n:.1f}} (at most a tenth of an increment), or zero the load "
            "cell at the machine"
        )
    if rig.load_frame is None:
        return None
    most_n = rig.limits.unloaded_max_n
    return UNLOADED_SHARE * rig.load_frame.limits.load_max_n if most_n is None else most_n, (
        "zero the load cell at the machine, or raise limits.unloaded_max_n in the rig file above {load_n:.1f}"
    )
