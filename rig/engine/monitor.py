"""Read all devices together: every reading is recorded, and checked before it is used."""

import math

from drivers.errors import DeviceFault
from drivers.interfaces import LoadFrameState
from rig.devices import Rig
from rig.engine.watch import Watch
from rig.protocol.step import Reading
from rig.recorder import Recorder


class Monitor:
    """Takes readings of stage and load frame.

    Parameters
    ----------
    rig : Rig
    recorder : Recorder
    watch : Watch or None
        The limits of the protocol, if it has any.
    """

    def __init__(self, rig: Rig, recorder: Recorder, watch: Watch | None) -> None:
        self._rig = rig
        self._recorder = recorder
        self._watch = watch
        self.homed = False

    def read(self, step: str) -> Reading:
        """Read every device of the rig; this also feeds the watchdog of the load frame.

        Raises
        ------
        DeviceError
            If a device does not answer or reports a fault.
        LimitViolation, SpecimenBroken
            If the reading is beyond what the protocol allows.
        """
        load_n = displacement_mm = angle_deg = math.nan
        moving = False
        if self._rig.load_frame is not None:
            state = self._rig.load_frame.read()
            self._recorder.load_frame_state(state)
            _require_no_faults(state, step)
            load_n, displacement_mm = state.load_n, state.displacement_mm
            # A load frame that regulates at its target may report that as motion.
            moving = state.moving and not state.at_target
        if self._rig.stage is not None:
            stage = self._rig.stage.read()
            self._recorder.stage_state(stage)
            angle_deg = stage.angle_deg
            moving = moving or stage.moving
            self.homed = stage.homed
        reading = Reading(self._rig.clock.now_s(), load_n, displacement_mm, angle_deg, moving)
        if self._watch is not None:
            self._watch.check(reading, step)
        return reading


def _require_no_faults(state: LoadFrameState, step: str) -> None:
    if state.faults:
        raise DeviceFault(
            "load_frame",
            step,
            "no fault",
            ", ".join(state.faults),
            "find the cause at the machine and clear the fault there",
        )
