"""Move to the target of each step and settle there, and say when its images are due."""

import math
from collections.abc import Callable, Iterator

from rig.engine.context import RunContext
from rig.engine.settle import settle
from rig.errors import SettleTimeout
from rig.protocol.step import ProtocolStep, RigReading

_PAUSE_MIN_S = 0.001


class _Paused(Exception):
    """Raised at a reading of a wait, because a pause was requested."""


class RunMotion:
    """Commands the motions and holds of a run, and waits for the times of their images.

    `reading` is the reading to which the newest images belong. If images were repeated, it is a new one. If
    the images of the step fell into a pause, together with the next ones, `missed` is True.
    """

    def __init__(self, run: RunContext) -> None:
        self.reading = RigReading(math.nan)
        self.missed = False
        self._run = run
        # of the present motion or hold: its beginning, the last reading within the tolerance, and the time
        # between two readings
        self._begun_s = self._kept_s = self._poll_s = math.nan

    def moments(self, step: ProtocolStep) -> Iterator[RigReading]:
        """Move to the target of a step, and yield a reading whenever all cameras are to take an image.

        The images of a step may be none, one or many, and the machine may move between them. The step ends
        with this iterator. If its event happens, the motion ends early, and everything stands still. After a
        pause the interrupted motion is commanded again.
        """
        self.reading = self._reach(step)
        has_arrived = not self.reading.moving and step.is_reached(self.reading) and not self._run.phase_ended
        # A motion that has arrived before the time of a step is imaged by its last step, after settling.
        if step.images and (step.stands or not has_arrived):
            for _ in range(self._run.protocol.images.per_step):
                if not self.missed and (paused_s := self._run.pauses.point("before its images")) is not None:
                    self._go_on(step, paused_s)
                    self.reading = self._arrive(step)
                if self.missed:
                    return
                yield self.reading

    def _reach(self, step: ProtocolStep) -> RigReading:
        """Move to the target of a step and settle there, or wait until the time of the step's images."""
        run = self._run
        run.phase_ended, run.event, self.missed = False, None, False
        if step.begins:
            if run.may_move:
                # Stop the motion of the step before. Its images were taken during the motion, which still
                # continues.
                self.stand_still()
            run.pauses.point("before its motion")
            self._command(step)
        run.event = step.event
        run.watch.expect(step.load_drop)
        if step.timed and step.begins:
            begun = self._settle(step) if step.holds else run.read()
            self._begun_s = self._kept_s = begun.time_s
            self._poll_s = run.watch.poll_s(run.settle.poll_s)
        return self._arrive(step)

    def _arrive(self, step: ProtocolStep) -> RigReading:
        """Wait until the images of a step are due, and return the last reading."""
        if step.timed and not self._run.phase_ended:
            reading = self._keep(step)
            if not self._run.phase_ended:
                return reading
        return self._settle(step)

    def _go_on(self, step: ProtocolStep, paused_s: float) -> None:
        """Command a step again after a pause of `paused_s`.

        The time of a motion stood still in the pause, so its later images wait. The time of a hold went on.
        """
        run = self._run
        if run.phase_ended:
            return
        self._command(step)
        run.watch.expect(step.load_drop)
        if step.holds:
            self._kept_s = run.pauses.ended_s
        elif step.timed:
            self._begun_s += paused_s

    def _keep(self, step: ProtocolStep) -> RigReading:
        """Read until the image time of a step, or until its event happens, and return the last reading.

        If a held value is outside its tolerance although nothing moves, it is commanded again. Raise
        `SettleTimeout` if the held value is outside its tolerance for longer than `settle.timeout_s`.
        """
        run = self._run
        while True:
            reading = run.read()
            if run.phase_ended:
                return reading
            if (paused_s := run.pauses.point("while it is under way")) is not None:
                self._go_on(step, paused_s)
                continue
            due_s = self._begun_s + step.at_s
            if due_s < run.pauses.ended_s and self._begun_s + step.next_s <= run.pauses.ended_s:
                self.missed = True
                run.pauses.missed(step)
                return reading
            if step.is_reached(reading):
                self._kept_s = reading.time_s
                if not (step.holds or reading.moving):
                    return reading
            elif step.holds:
                self._require_kept(step, reading)
                if not reading.moving:
                    self._command(step)
            left_s = due_s - reading.time_s
            if left_s <= 0.0:
                if due_s < run.pauses.ended_s:
                    run.pauses.late(step, -left_s)
                return reading
            # Wait at least a short time, because a remainder from rounding would let no time pass.
            run.calls.pause(min(self._poll_s, max(left_s, _PAUSE_MIN_S)))

    def _require_kept(self, step: ProtocolStep, reading: RigReading) -> None:
        timeout_s = self._run.settle.timeout_s
        if reading.time_s - self._kept_s > timeout_s:
            raise SettleTimeout(
                f"{step}, holding",
                f"{step.target:.6g} ± {step.tolerance:g}",
                f"{step.value(reading):.6g} for {timeout_s:g} s",
                "look at the specimen and the load frame; if both are sound, raise the tolerance or "
                f"settle.timeout_s above {timeout_s:g}",
            )

    def stand_still(self) -> None:
        """Hold the load frame and wait until no device moves, so that the operator may reach into the rig."""
        self._run.devices.hold()
        self.wait("standing still for the operator", "standstill", lambda _: True)

    def stand_for(self, step: ProtocolStep) -> None:
        """Let everything stand still for a step that neither moves nor holds a value, such as a question."""
        run = self._run
        run.phase_ended, run.event = False, None
        self.stand_still()
        run.watch.begin(step)
        run.watch.expect(step.load_drop)

    def settle_again(self, step: ProtocolStep) -> RigReading:
        """Before images are repeated, wait until the readings have settled, except in a motion or hold."""
        in_time = step.timed and not self._run.phase_ended
        self.reading = self._run.read() if in_time else self._settle(step)
        return self.reading

    def wait(
        self,
        doing: str,
        expected: str,
        within: Callable[[RigReading], bool],
        motion_s: float = 0.0,
        again: Callable[[float], None] = lambda paused_s: None,
    ) -> RigReading:
        """Wait until nothing moves and every reading was within its tolerance for the dwell time.

        `doing` and `expected` are the action and the expected result, for the message of an error. `within`
        returns True if a reading is within its tolerance. `motion_s` is the planned time of the motion in s,
        by which the wait may be longer than `settle.timeout_s`. `again` is called after a pause, with its
        duration in s, and commands the motion again.
        """
        run = self._run

        def read() -> RigReading:
            reading = run.read()
            if run.pauses.asked(doing):
                raise _Paused
            return reading

        while True:
            try:
                reading = settle(
                    read,
                    lambda reading: not reading.moving and within(reading),
                    dwell_s=run.settle.dwell_s,
                    timeout_s=run.settle.timeout_s + motion_s,
                    poll_s=run.watch.poll_s(run.settle.poll_s),
                    clock=run.clock,
                    pause=run.calls.pause,
                    step=f"{run.place}, {doing}",
                    expected=expected,
                )
            except _Paused:
                again(run.pauses.point(doing) or 0.0)
            else:
                run.may_move = False
                return reading

    def _command(self, step: ProtocolStep) -> None:
        """Command the target of a step and return at once."""
        run = self._run
        run.check_abort()
        run.watch.begin(step)
        run.may_move = run.may_move or not math.isnan(step.target)
        if step.kind == "relaxation":
            run.devices.hold()
        elif step.quantity is not None:
            run.devices.go_to(step.quantity, step.target, step.rate)

    def _settle(self, step: ProtocolStep) -> RigReading:
        def again(paused_s: float) -> None:
            self._go_on(step, paused_s)

        if math.isnan(step.target):
            return self.wait("settling", "standstill", lambda _: True, again=again)
        return self.wait(
            "settling",
            f"{step.target:.6g} ± {step.tolerance:g}",
            lambda reading: self._run.phase_ended or step.is_reached(reading),
            step.motion_s,
            again,
        )
