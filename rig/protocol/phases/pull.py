"""The phase `pull`: a motion without interruption in stages, with images at times or events meanwhile."""

import math
from dataclasses import replace
from typing import Literal, Self

from pydantic import Field, model_validator

from drivers.settings import Settings
from rig.protocol.acquire import Acquisition
from rig.protocol.acquisition_tables import End, Level, Schedule
from rig.protocol.draft import Draft, IfNever, Phase, Positive, Signed
from rig.protocol.pull_stages import PullPlan, PullStage, SpeedBounds, StageEnds, StrainRate

_FASTER, _SLOWER = 10.0, 0.02
"""Bounds of the speed under a strain rate, as multiples of strain rate times parallel length. In the elastic
range a soft machine takes up most of the motion, so the crosshead must be faster than the specimen needs."""
_RAMP_S = 1.0
"""In this time in s the speed may change by strain rate times parallel length."""


class StageUntil(Settings):
    """What ends a stage; the first to happen if several are given."""

    load_n: float | None = Field(default=None, description="load, negative in compression")
    stress_mpa: float | None = Field(default=None, description="load over the cross section of the sample")
    displacement_mm: float | None = None
    strain: float | None = Field(default=None, description="strain of a live gauge, such as 0.002")
    gauge: str | None = Field(default=None, description="the gauge of `strain`; default: that of the stage")
    load_drop: float | None = Field(default=None, gt=0.0, lt=1.0)
    duration_s: float | None = Field(default=None, gt=0.0)
    reaches: Level | None = Field(default=None, description="a signal is beyond a level")
    if_never: IfNever = "fail"

    @model_validator(mode="after")
    def _at_least_one(self) -> Self:
        names = ("load_n", "stress_mpa", "displacement_mm", "strain", "load_drop", "duration_s", "reaches")
        if all(getattr(self, name) is None for name in names):
            raise ValueError(f"at least one of {', '.join(names)} is expected")
        if self.load_n is not None and self.stress_mpa is not None:
            raise ValueError("only one of load_n and stress_mpa is expected; remove the other")
        return self


class Stage(Settings):
    """One stage of a pull: exactly one of the first five keys says how fast."""

    speed_mm_s: Positive | None = None
    crosshead_strain_rate_s: Positive | None = Field(
        default=None, description="speed over the parallel length (ISO 6892-1, method A2)"
    )
    strain_rate_s: Positive | None = Field(
        default=None, description="strain rate of a live gauge (ISO 6892-1, method A1)"
    )
    rate_n_s: Positive | None = None
    stress_rate_mpa_s: Positive | None = Field(
        default=None, description="rate of the load over the cross section (ISO 6892-1, method B)"
    )
    gauge: str | None = Field(default=None, description="the live gauge of strain_rate_s")
    parallel_length_mm: Positive | None = None
    speed_max_mm_s: Positive | None = Field(
        default=None, description="greatest speed under strain_rate_s; 10 times strain rate times length"
    )
    acceleration_mm_s2: Positive | None = Field(
        default=None, description="greatest change of this speed; strain rate times length in 1 s"
    )
    yield_drop: float = Field(
        default=0.005, gt=0.0, lt=0.5, description="fall of the load that means discontinuous yielding"
    )
    return_s: float = Field(
        default=0.0, ge=0.0, le=3600.0, description="the machine may be held so long for an invalid gauge"
    )
    until: StageUntil | None = None

    @model_validator(mode="after")
    def _agrees_with_itself(self) -> Self:
        rates = (
            "speed_mm_s",
            "crosshead_strain_rate_s",
            "strain_rate_s",
            "rate_n_s",
            "stress_rate_mpa_s",
        )
        given = [name for name in rates if getattr(self, name) is not None]
        if len(given) != 1:
            raise ValueError(
                f"exactly one of {', '.join(rates)} is expected, got {', '.join(given) or 'none'}"
            )
        length = {"crosshead_strain_rate_s", "strain_rate_s"} & set(given)
        if bool(length) != (self.parallel_length_mm is not None):
            raise ValueError("parallel_length_mm is expected with a strain rate, and only there")
        only = ("gauge", "speed_max_mm_s", "acceleration_mm_s2")
        if self.strain_rate_s is None and (extra := [name for name in only if getattr(self, name)]):
            raise ValueError(f"{' and '.join(extra)} belong to strain_rate_s only; remove them")
        if self.strain_rate_s is not None and self.gauge is None:
            raise ValueError(
                "gauge is missing; add the name of a live gauge, because it gives the strain rate"
            )
        if self.until is not None and self.until.strain is not None and not (self.until.gauge or self.gauge):
            raise ValueError("until.gauge is missing; add the name of a live gauge")
        of_load = self.rate_n_s is not None or self.stress_rate_mpa_s is not None
        if of_load and (self.until is None or (self.until.load_n is None and self.until.stress_mpa is None)):
            raise ValueError(
                "until.load_n or until.stress_mpa is missing; add it, as a rate of the load needs its target"
            )
        return self


class Pull(Phase):
    """A motion to a displacement without interruption. Its first stage may stand in the table itself."""

    do: Literal["pull"]
    displacement_mm: Signed = Field(description="farthest displacement; negative in compression")
    images: Schedule = Field(description="when images are due, as in the table [acquire]")
    stages: list[Stage] = Field(min_length=1, max_length=100)
    elastic_n: float = Field(
        default=0.0, ge=0.0, description="load up to which the specimen is certainly elastic"
    )

    def compile(self, draft: Draft) -> None:
        """Add the motion, with the greatest speed of its stages as a demand on the rig."""
        draft.push("displacement", self.displacement_mm)
        compiled = [self._compiled(draft, stage, number) for number, stage in enumerate(self.stages, 1)]
        speeds_mm_s = [stage.greatest_mm_s for stage in compiled if not stage.is_of_load]
        move = draft.move_to("displacement", self.displacement_mm, max(speeds_mm_s, default=math.nan))
        for stage in compiled:
            if stage.is_of_load:
                draft.move_to("load", stage.load_n, stage.rate_n_s)
                draft.increments_n.append(abs(stage.load_n))
        draft.expect(0.0, self.elastic_n)
        if any(stage.strain_rate_s is not None for stage in self.stages):
            draft.strain_rates.append(draft.where)
        if any(stage.until is None for stage in self.stages[:-1]):
            draft.mistake("until is missing in a stage before the last one; add it")
        if self.images.begin is not None or self.images.on_request is not None:
            draft.mistake("images.begin and images.on_request belong to a protocol of the kind acquire")
        last = self.stages[-1].until
        plan = PullPlan(
            draft.where,
            self.displacement_mm,
            move.tolerance,
            tuple(compiled),
            last is not None and last.if_never == "fail",
            self._planned_s(compiled),
        )
        draft.gauges |= plan.gauges | set(self.images.gauges)
        draft.signals |= plan.signals | set(self.images.signals)
        draft.add(Acquisition(self.images, End(on_request=True), pull=plan))

    def _compiled(self, draft: Draft, stage: Stage, number: int) -> PullStage:
        sense = math.copysign(1.0, self.displacement_mm)
        ends = self._ends(draft, stage, sense)
        rate_n_s = stage.rate_n_s or (stage.stress_rate_mpa_s or math.nan) * draft.area_mm2
        if stage.rate_n_s is not None or stage.stress_rate_mpa_s is not None:
            # The machine may settle a little below its target.
            tolerance_n = sense * draft.move("load", rate_n_s).tolerance
            nearly = replace(ends, load_n=ends.load_n - tolerance_n)
            return PullStage(math.nan, nearly, f"{rate_n_s:g} N/s", rate_n_s, ends.load_n)
        length_mm = stage.parallel_length_mm or math.nan
        if stage.strain_rate_s is None:
            speed_mm_s = stage.speed_mm_s or (stage.crosshead_strain_rate_s or math.nan) * length_mm
            return PullStage(speed_mm_s, ends, f"{speed_mm_s:g} mm/s")
        needed_mm_s = stage.strain_rate_s * length_mm
        greatest_mm_s = stage.speed_max_mm_s or _FASTER * needed_mm_s
        if greatest_mm_s < needed_mm_s:
            draft.mistake(
                f"stage {number}: speed_max_mm_s must be at least {needed_mm_s:g}, the strain rate times the "
                f"parallel length, got {greatest_mm_s:g}"
            )
        bounds = SpeedBounds(
            _SLOWER * needed_mm_s, greatest_mm_s, stage.acceleration_mm_s2 or needed_mm_s / _RAMP_S
        )
        assert stage.gauge is not None
        kept = StrainRate(
            stage.strain_rate_s, stage.gauge, length_mm, bounds, stage.yield_drop, stage.return_s
        )
        text = f"{stage.strain_rate_s:g} /s of the gauge {stage.gauge}"
        return PullStage(needed_mm_s, ends, text, strain_rate=kept)

    def _ends(self, draft: Draft, stage: Stage, sense: float) -> StageEnds:
        until = stage.until
        if until is None:
            return StageEnds(sense)
        levels = [] if until.reaches is None else [until.reaches]
        if until.strain is not None:
            gauge = until.gauge or stage.gauge
            side = "above" if sense > 0.0 else "below"
            levels.append(Level.model_validate({"channel": f"gauge.{gauge}", side: until.strain}))
        load_n = until.load_n
        if until.stress_mpa is not None:
            load_n = until.stress_mpa * draft.area_mm2
        return StageEnds(
            sense,
            math.nan if load_n is None else load_n,
            math.nan if until.displacement_mm is None else until.displacement_mm,
            math.nan if until.duration_s is None else until.duration_s,
            tuple(levels),
            None if until.load_drop is None else draft.drop(until.load_drop, sense),
        )

    def _planned_s(self, stages: list[PullStage]) -> float:
        speeds_mm_s = [stage.speed_mm_s for stage in stages if not stage.is_of_load]
        loads_s = sum(abs(stage.load_n) / stage.rate_n_s for stage in stages if stage.is_of_load)
        slowest_mm_s = min(speeds_mm_s, default=math.inf)
        return abs(self.displacement_mm) / slowest_mm_s + loads_s
