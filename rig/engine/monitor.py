"""Read stage, load frame and interlocks together. Record every reading, and check it against the limits."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from drivers.clock import Clock
from drivers.errors import DeviceFault
from drivers.interfaces import InterlockState, LoadFrameState
from rig.engine.calls import Call, Calls
from rig.engine.devices import Devices
from rig.engine.watch import Watch
from rig.protocol.step import RigReading
from rig.recorder import Recorder
from rig.samples import DISPLACEMENT, LOAD, SignalReading


@dataclass(frozen=True)
class MeasuredChannels:
    """The channels of a run, and which of their signals are load and displacement.

    `read` returns what all signals did since the last call. `names` has the signals' names by quantity.
    """

    read: Callable[[], dict[str, SignalReading]] = dict
    names: Mapping[str, str] = field(default_factory=dict)

    def quantities(self, signals: Mapping[str, SignalReading]) -> dict[str, float]:
        """Return the newest load in N and displacement in mm, if they are measured."""
        return {quantity: signals[name].newest for quantity, name in self.names.items() if name in signals}


class Monitor:
    """Takes readings of the stage, the load frame, the interlocks and the measured channels.

    The recorder records every reading, and `watch` checks it against the limits of the run. A motion by hand
    has neither of them.
    """

    def __init__(
        self,
        devices: Devices,
        calls: Calls,
        clock: Clock,
        recorder: Recorder | None = None,
        watch: Watch | None = None,
        channels: "MeasuredChannels | None" = None,
    ) -> None:
        self._devices = devices
        self._calls = calls
        self._clock = clock
        self._recorder = recorder
        self._watch = watch
        self._channels = channels or MeasuredChannels()
        self.homed = False

    def read(self, step: str) -> RigReading:
        """Read all devices except the cameras. Each reading also resets the watchdog of the load frame.

        Raise `DeviceError` if a device does not answer or reports a fault, `LimitViolation` or
        `SpecimenBroken` if the reading violates a limit of the run, and `InterlockOpen` if an interlock's
        value is out of bounds.
        """
        load_n = displacement_mm = angle_deg = math.nan
        time_s, of_frame_s, moving = -math.inf, -math.inf, False
        frame, stage = self._devices.load_frame, self._devices.stage
        # Begin both readings before waiting, so that the load frame is read even if the stage hangs.
        of_frame = None if frame is None else frame.begin_read()
        of_stage = None if stage is None else stage.begin_read()
        interlocks = self._devices.interlocks
        of_interlocks = {name: each.begin_read() for name, each in interlocks.items()}
        if of_frame is not None:
            state = self._calls.finish(of_frame)
            if self._recorder is not None:
                self._recorder.load_frame_state(state)
            _require_no_faults(state, step)
            load_n, displacement_mm, time_s = state.load_n, state.displacement_mm, state.time_s
            of_frame_s = time_s
            # At its target, a load frame may report small corrections by its controller as motion.
            moving = state.moving and not state.at_target
        if of_stage is not None:
            turned = self._calls.finish(of_stage)
            if self._recorder is not None:
                self._recorder.stage_state(turned)
            angle_deg, time_s = turned.angle_deg, max(time_s, turned.time_s)
            moving = moving or turned.moving
            if self.homed and not turned.homed:
                raise DeviceFault(
                    "stage",
                    step,
                    "a stage with its reference position",
                    "one that has lost it",
                    "find out whether its power failed or something pushed it, then begin a new run",
                )
            self.homed = turned.homed
        signals = self._channels.read()
        if of_frame is not None:
            signals |= _of_load_frame(load_n, displacement_mm, of_frame_s)
        measured = self._channels.quantities(signals)
        load_n = measured.get("load", load_n)
        displacement_mm = measured.get("displacement", displacement_mm)
        time_s = self._clock.now_s() if time_s == -math.inf else time_s
        reading = RigReading(time_s, load_n, displacement_mm, angle_deg, moving, signals=signals)
        if self._watch is not None:
            self._watch.check(reading, step)
        # Wait for the interlocks only after the limits were checked, because a slow interlock must not delay
        # this check. Record the values of all interlocks before one of them ends the run.
        values = {name: self._record(name, call) for name, call in of_interlocks.items()}
        for name, value in values.items():
            interlocks[name].driver.require_good(name, value, step)
        return reading

    def _record(self, name: str, call: Call[InterlockState]) -> InterlockState:
        state = self._calls.finish(call)
        if self._recorder is not None:
            self._recorder.interlock_state(name, state)
        return state


def _of_load_frame(load_n: float, displacement_mm: float, time_s: float) -> dict[str, SignalReading]:
    """Return load and displacement of a load frame as signals."""
    at_s = np.array([time_s])
    return {
        LOAD: SignalReading(np.array([load_n]), at_s, unit="N"),
        DISPLACEMENT: SignalReading(np.array([displacement_mm]), at_s, unit="mm"),
    }


def _require_no_faults(state: LoadFrameState, step: str) -> None:
    if state.faults:
        raise DeviceFault(
            "load_frame",
            step,
            "no fault",
            ", ".join(state.faults),
            "find the cause at the machine and clear the fault there",
        )
