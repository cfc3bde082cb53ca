"""Move to the target of each step and settle there, or wait until the time of the step's images."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from drivers.clock import Clock
from rig.engine.devices import CalledLoadFrame, CalledStage, Devices
from rig.engine.keep import Keeper
from rig.engine.settle import settle
from rig.engine.watch import Watch
from rig.protocol.step import ProtocolStep, Reading
from rig.protocol.tables import Settle


@dataclass(frozen=True)
class Around:
    """Functions of the engine that `Motion` needs.

    Attributes
    ----------
    read : callable
        Reads stage and load frame, checks the limits, and returns the reading.
    pause : callable
        Waits for the given time in s.
    check_abort : callable
        Raises an exception if the end of the run was requested.
    place : callable
        Returns the name of the present step, for messages.
    """

    read: Callable[[], Reading]
    pause: Callable[[float], None]
    check_abort: Callable[[], None]
    place: Callable[[], str]


class Motion:
    """Commands the motions and holds of a run, and waits until each of them has ended.

    Parameters
    ----------
    times : Settle
    devices : Devices
    watch : Watch
        Checks every commanded motion against the limits of the run.
    clock : Clock
    around : Around

    Attributes
    ----------
    may_move : bool
        True if a device may be moving. At the beginning of a run, a device may still be moving for an earlier
        program that was killed.
    phase_ended : bool
        True if the event that ends the phase has happened during the present step.
    """

    def __init__(self, times: Settle, devices: Devices, watch: Watch, clock: Clock, around: Around) -> None:
        self.may_move = True
        self.phase_ended = False
        self._event: Callable[[Reading], bool] | None = None
        self._times = times
        self._devices = devices
        self._watch = watch
        self._clock = clock
        self._around = around
        self._keeper: Keeper | None = None

    def note_motion(self) -> None:
        """Record that a device may be moving from now on."""
        self.may_move = True

    def see(self, reading: Reading) -> bool:
        """If the event of the present step happens, hold the load frame and return True.

        The engine calls this method with every reading, also while images are taken.
        """
        if self.phase_ended or self._event is None or not self._event(reading):
            return False
        self.phase_ended = True
        if self._devices.load_frame is not None:
            self._devices.load_frame.hold()
        return True

    def reach(self, step: ProtocolStep) -> Reading:
        """Move to the target of a step and settle there, or wait until the time of the step's images.

        If the event of the step happens, the motion ends early, and everything stands still.
        """
        self.phase_ended, self._event = False, None
        if step.begins:
            if self.may_move:
                # Stop the motion of the step before. Its images were taken during the motion, which still
                # continues.
                self.stand_still()
            self._command(step)
        self._event = step.event
        self._watch.expect(step.load_drop)
        if not step.timed:
            return self._settle(step)
        if step.begins:
            begun = self._settle(step) if step.holds else self._around.read()
            self._keeper = Keeper(
                begun.time_s,
                self._around.read,
                self._around.pause,
                timeout_s=self._times.timeout_s,
                poll_s=self._watch.poll_s(self._times.poll_s),
                ended=lambda: self.phase_ended,
            )
        assert self._keeper is not None  # the first timed step of this motion or hold has set the keeper
        reading = self._keeper.wait(step, correct=lambda: self._command(step))
        return self._settle(step) if self.phase_ended else reading

    def stand_still(self) -> None:
        """Hold the load frame and wait until no device moves, so that the operator may reach into the rig."""
        if self._devices.load_frame is not None:
            self._devices.load_frame.hold()
        self.wait("standing still for the operator", "standstill", lambda _: True)

    def settle_again(self, step: ProtocolStep) -> Reading:
        """Before images are repeated, wait until the readings have settled, except in a motion or hold."""
        return self._around.read() if step.timed and not self.phase_ended else self._settle(step)

    def wait(
        self, doing: str, expected: str, within: Callable[[Reading], bool], motion_s: float = 0.0
    ) -> Reading:
        """Wait until nothing moves and every reading was within its tolerance for the dwell time.

        Parameters
        ----------
        doing, expected : str
            The action and the expected result, for the message of an error.
        within : callable
            Returns True if a reading is within its tolerance.
        motion_s : float
            Planned time of the motion in s, by which the wait may be longer than `settle.timeout_s`.
        """
        reading = settle(
            self._around.read,
            lambda reading: not reading.moving and within(reading),
            dwell_s=self._times.dwell_s,
            timeout_s=self._times.timeout_s + motion_s,
            poll_s=self._watch.poll_s(self._times.poll_s),
            clock=self._clock,
            pause=self._around.pause,
            step=f"{self._around.place()}, {doing}",
            expected=expected,
        )
        self.may_move = False
        return reading

    def _command(self, step: ProtocolStep) -> None:
        self._around.check_abort()
        self._watch.begin(step)
        self.may_move = self.may_move or not math.isnan(step.target)
        _begin(step, self._devices)

    def _settle(self, step: ProtocolStep) -> Reading:
        if math.isnan(step.target):
            return self.wait("settling", "standstill", lambda _: True)
        expected = f"{step.target:.6g} ± {step.tolerance:g}"
        return self.wait(
            "settling",
            expected,
            lambda reading: self.phase_ended or step.is_reached(reading),
            step.motion_s,
        )


def _begin(step: ProtocolStep, devices: Devices) -> None:
    """Command the target of a step and return at once. The rig must have the device."""
    if step.kind == "relaxation":
        _load_frame(devices).hold()
    elif step.quantity == "load":
        _load_frame(devices).go_to_load(step.target, step.rate)
    elif step.quantity == "displacement":
        _load_frame(devices).go_to_displacement(step.target, step.rate)
    elif step.quantity == "rotation":
        _stage(devices).move_to(step.target)


def _load_frame(devices: Devices) -> CalledLoadFrame:
    assert devices.load_frame is not None  # `require_devices` has checked this
    return devices.load_frame


def _stage(devices: Devices) -> CalledStage:
    assert devices.stage is not None  # `require_devices` has checked this
    return devices.stage
