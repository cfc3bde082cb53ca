"""What moves the specimen while images are taken at times or events: nothing, or the load frame in stages."""

import math
from collections import deque
from collections.abc import Callable
from dataclasses import replace

from drivers.errors import DeviceFault
from rig.engine.context import RunContext
from rig.engine.strain_rate import Point, StrainRateControl, Way
from rig.errors import GaugeNotValid, ProtocolError, SettleTimeout
from rig.protocol.pull_stages import PullPlan, PullStage, StageWatch
from rig.protocol.step import Kind, ProtocolStep, RigReading

_KEPT_READINGS = 400
"""Readings that are kept, to know displacement and load at the time of a strain."""
_SPEED_STEP = 0.01
"""A new speed that differs by less than this share is not commanded."""
_POLLS_PER_FRAME = 4.0
_CONFIRMING = 5
"""Number of valid values in a row after which a gauge counts as valid again."""
_HELD = ProtocolStep(0, "rest", load_drop="slow")


class Drive:
    """Moves the specimen during an acquisition. This one moves nothing, beside a machine without commands."""

    @property
    def poll_s(self) -> float:
        """Longest time in s between two readings."""
        return math.inf

    def begin(self) -> None:
        """Command the first motion."""

    def see(self, _: RigReading) -> str:
        """Steer by a reading. Return why the motion is over, or an empty text."""
        return ""

    def again(self, paused_s: float) -> None:
        """Go on after a pause, in which the machine was held."""

    def end(self) -> None:
        """Hold the machine, because no more images are needed."""


class MachineDrive(Drive):
    """Moves the load frame through the stages of a pull, without a stop between them.

    `stand_still` holds the machine and waits for standstill before the first command.
    """

    def __init__(
        self, run: RunContext, plan: PullPlan, first: ProtocolStep, stand_still: Callable[[], None]
    ) -> None:
        self._run, self._plan, self._first = run, plan, first
        self._stand_still = stand_still
        self._number = 0
        self._watch: StageWatch = plan.stages[0].ends.watch(math.nan)
        self._control: StrainRateControl | None = None
        self._readings: deque[RigReading] = deque(maxlen=_KEPT_READINGS)
        self._begun_s = self._moved_s = math.nan
        self._speed_mm_s = math.nan
        self._held_s: float | None = None
        self._confirmed = 0

    @property
    def poll_s(self) -> float:
        """Longest time in s between two readings."""
        poll_s = self._run.watch.poll_s(self._run.settle.poll_s)
        if not self._gauges:
            return poll_s
        return min(poll_s, self._run.live.interval_s / _POLLS_PER_FRAME)

    @property
    def _stage(self) -> PullStage:
        return self._plan.stages[self._number]

    @property
    def _gauges(self) -> set[str]:
        """The gauges without which nothing may move now."""
        return self._stage.gauges | self._run.live.limited

    def begin(self) -> None:
        """Command the first stage."""
        run = self._run
        if run.may_move:
            self._stand_still()
        reading = run.read()
        self._begun_s = self._moved_s = reading.time_s
        self._enter(0, reading)

    def see(self, reading: RigReading) -> str:
        """Steer by a reading: look for the end of the stage, and keep its strain rate."""
        self._readings.append(reading)
        if self._held_s is not None:
            self._wait_for_gauges(reading)
            return ""
        self._watch.see(reading)
        if self._watch.met:
            self._run.log("info", f"stage {self._number + 1} ends: {self._watch.met}")
            if self._number + 1 == len(self._plan.stages):
                return self._over(self._watch.met)
            self._enter(self._number + 1, reading)
            return ""
        if (invalid := self._invalid_gauge()) is not None:
            self._hold_for(*invalid, reading)
            return ""
        self._require_progress(reading)
        if self._arrived(reading):
            return self._over_at_target(reading)
        if self._control is not None:
            self._steer(self._control, reading)
        return ""

    def again(self, paused_s: float) -> None:
        """Command the present stage again after a pause."""
        self._begun_s += paused_s
        self._watch.renew(paused_s)
        self._moved_s = self._run.clock.now_s()
        if self._control is not None:
            self._control.begin_again()
        self._command()

    def end(self) -> None:
        """Hold the machine."""
        self._run.devices.hold()

    def _enter(self, number: int, reading: RigReading) -> None:
        self._number = number
        stage, run = self._stage, self._run
        self._watch = stage.ends.watch(reading.time_s)
        self._control = None
        if stage.strain_rate is not None:
            self._control = StrainRateControl(stage.strain_rate, run.live.interval_s, run.live.latency_s)
        run.log("info", f"stage {number + 1}: {stage.text} until {stage.ends}")
        self._command()

    def _command(self) -> None:
        """Command the motion of the present stage; a motion that goes on only changes its speed."""
        stage, run = self._stage, self._run
        run.check_abort()
        was_moving = run.may_move and not math.isnan(self._speed_mm_s)
        step = self._step(stage)
        run.watch.begin(step)
        run.watch.expect(step.load_drop)
        run.may_move = True
        if stage.is_of_load:
            self._speed_mm_s = math.nan
            run.devices.go_to("load", stage.load_n, stage.rate_n_s)
            return
        speed_mm_s = stage.speed_mm_s if self._control is None else self._control.speed_mm_s
        if was_moving and run.devices.can_change_speed:
            self._change(speed_mm_s)
        else:
            run.devices.go_to("displacement", self._plan.displacement_mm, speed_mm_s)
            self._speed_mm_s = speed_mm_s
            run.watch.change_speed(speed_mm_s)

    def _step(self, stage: PullStage) -> ProtocolStep:
        """Return the motion of a stage as a step, for the limits."""
        kind: Kind = "load" if stage.is_of_load else "displacement"
        target = stage.load_n if stage.is_of_load else self._plan.displacement_mm
        rate = stage.rate_n_s if stage.is_of_load else stage.greatest_mm_s
        drop = stage.ends.load_drop
        event = None if drop is None else drop.at_readings()
        return replace(self._first, kind=kind, target=target, rate=rate, at_s=math.nan, event=event)

    def _steer(self, control: StrainRateControl, reading: RigReading) -> None:
        kept = self._stage.strain_rate
        assert kept is not None
        sense = self._stage.ends.sense
        was_discontinuous = control.is_discontinuous
        control.see_load(Way(reading.time_s, sense * reading.displacement_mm, sense * reading.load_n))
        for time_s, strain in self._run.live.strains(kept.gauge, reading):
            displacement_mm, load_n = self._at(time_s)
            control.see(Point(time_s, sense * strain, sense * displacement_mm, sense * load_n))
        if control.is_discontinuous and not was_discontinuous:
            self._run.log(
                "info",
                f"discontinuous yielding at {reading.load_n:.6g} N: the strain rate of a gauge says nothing "
                f"about the specimen, so the crosshead goes on at {control.speed_mm_s:.4g} mm/s, the strain "
                "rate times the parallel length",
            )
        if abs(control.speed_mm_s - self._speed_mm_s) > _SPEED_STEP * self._speed_mm_s:
            self._change(control.speed_mm_s)

    def _change(self, speed_mm_s: float) -> None:
        try:
            self._run.devices.change_speed(speed_mm_s)
        except DeviceFault:
            # A machine that was held for a pause or an abort, or that has arrived meanwhile, refuses it.
            self._run.check_abort()
            if not self._run.pauses.switch.on and not self._arrived(self._run.read()):
                raise
            return
        self._speed_mm_s = speed_mm_s
        self._run.watch.change_speed(speed_mm_s)

    def _at(self, time_s: float) -> tuple[float, float]:
        """Return displacement and load at a time, interpolated between the readings."""
        after = self._readings[-1]
        for before in reversed(self._readings):
            if before.time_s <= time_s:
                break
            after = before
        else:
            return after.displacement_mm, after.load_n
        span_s = after.time_s - before.time_s
        share = (time_s - before.time_s) / span_s if span_s > 0.0 else 0.0
        return (
            before.displacement_mm + share * (after.displacement_mm - before.displacement_mm),
            before.load_n + share * (after.load_n - before.load_n),
        )

    def _invalid_gauge(self) -> tuple[str, str] | None:
        """Return a gauge that the stage needs and that is not valid, and why; None if all are valid."""
        for gauge in sorted(self._gauges):
            if reason := self._run.live.not_valid(gauge):
                return gauge, reason
        return None

    def _hold_for(self, gauge: str, reason: str, reading: RigReading) -> None:
        """Hold the machine at once, and wait for the gauge if the stage permits it."""
        run, kept = self._run, self._stage.strain_rate
        run.devices.hold()
        return_s = 0.0 if kept is None else kept.return_s
        run.log("warning", f"the machine is held, because the gauge {gauge} is not valid: {reason}")
        if not return_s > 0.0:
            raise GaugeNotValid(
                f"{self._plan.where}, stage {self._number + 1}, at {reading.load_n:.6g} N",
                f"a valid strain of the gauge {gauge}",
                reason,
                "look at the specimen, light and lens, and at the images up to here, which are on file; "
                "return_s lets the machine wait for the gauge",
            )
        self._held_s, self._confirmed = run.clock.now_s(), 0
        self._speed_mm_s = math.nan
        step = replace(_HELD, index=self._first.index)
        run.watch.begin(step)
        run.watch.expect(step.load_drop)

    def _wait_for_gauges(self, reading: RigReading) -> None:
        assert self._held_s is not None
        kept, now_s = self._stage.strain_rate, self._run.clock.now_s()
        invalid = self._invalid_gauge()
        self._confirmed = 0 if invalid is not None else self._confirmed + self._run.live.is_new
        if self._confirmed >= _CONFIRMING:
            paused_s = now_s - self._held_s
            self._run.log("info", f"the gauges are valid again after {paused_s:.1f} s; the motion goes on")
            self._held_s = None
            self.again(paused_s)
        elif kept is None or now_s - self._held_s > kept.return_s:
            gauge, reason = invalid or (kept.gauge if kept else "", "valid values too late")
            raise GaugeNotValid(
                f"{self._plan.where}, stage {self._number + 1}, at {reading.load_n:.6g} N",
                f"a valid strain of the gauge {gauge} within return_s, {now_s - self._held_s:.3g} s",
                reason,
                "look at the specimen, light and lens; the images up to here are on file",
            )

    def _require_progress(self, reading: RigReading) -> None:
        """Raise `SettleTimeout` if the machine stands still, or the whole motion takes too long."""
        run, plan = self._run, self._plan
        if reading.moving:
            self._moved_s = reading.time_s
        elif reading.time_s - self._moved_s > run.settle.timeout_s and not self._arrived(reading):
            raise SettleTimeout(
                f"{plan.where}, stage {self._number + 1}",
                f"a motion towards {plan.displacement_mm:g} mm",
                f"standstill at {reading.displacement_mm:.6g} mm for {run.settle.timeout_s:g} s",
                "look at the machine, whose own limits or key switch may have stopped it",
            )
        longest_s = plan.longest_s + run.settle.timeout_s
        if reading.time_s - self._begun_s > longest_s:
            raise SettleTimeout(
                f"{plan.where}, stage {self._number + 1}",
                f"the end of the motion within {longest_s:.4g} s, three times its planned time",
                f"{reading.displacement_mm:.6g} mm and {reading.load_n:.6g} N",
                "check the speeds of the stages, and what should end them",
            )

    def _arrived(self, reading: RigReading) -> bool:
        off_mm = abs(reading.displacement_mm - self._plan.displacement_mm)
        return not reading.moving and off_mm <= self._plan.tolerance_mm

    def _over(self, met: str) -> str:
        self.end()
        return met

    def _over_at_target(self, reading: RigReading) -> str:
        plan = self._plan
        self.end()
        if not plan.fails_at_target:
            return f"{plan.displacement_mm:g} mm were reached"
        raise ProtocolError(
            f"{plan.where}, at {reading.load_n:.0f} N and {reading.displacement_mm:.4g} mm",
            f"the end of its stages: {plan.stages[-1].ends}",
            "the farthest displacement before it",
            'go farther in this phase, or set until.if_never = "go-on"',
        )


def drive_of(run: RunContext, step: ProtocolStep, plan: PullPlan | None, stand: Callable[[], None]) -> Drive:
    """Return what moves the specimen during an acquisition that begins with a step."""
    return Drive() if plan is None else MachineDrive(run, plan, step, stand)
