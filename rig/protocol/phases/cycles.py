"""The phase `cycles`: cycles between two loads or between two displacements."""

import math
from dataclasses import dataclass, replace
from typing import Literal, Self

from pydantic import Field, model_validator

from drivers.settings import Settings
from rig.protocol.course import Positions
from rig.protocol.draft import Draft, IfNever, Phase
from rig.protocol.move import Ending, Move
from rig.protocol.step import Execute, ProtocolStep, Quantity, RigReading

CYCLES_MAX = 20_000


class CycleImages(Settings):
    """The cycles with images, which are taken at both ends. The first and last cycle always have images."""

    every_cycles: int = Field(default=1, ge=1)


class CyclesUntil(Settings):
    """The event that ends the cycles before the last cycle."""

    load_drop: float = Field(
        gt=0.0, lt=1.0, description="fraction by which the load at the outer end of a cycle must drop"
    )
    if_never: IfNever = "fail"


class Cycles(Phase):
    """Cycles between two loads or between two displacements."""

    do: Literal["cycles"]
    count: int = Field(ge=1, le=CYCLES_MAX)
    low_n: float | None = None
    high_n: float | None = None
    rate_n_s: float | None = Field(default=None, gt=0.0)
    low_mm: float | None = None
    high_mm: float | None = None
    speed_mm_s: float | None = Field(default=None, gt=0.0)
    images: CycleImages = CycleImages()
    until: CyclesUntil | None = None

    @model_validator(mode="after")
    def _one_quantity(self) -> Self:
        of_load = {"low_n": self.low_n, "high_n": self.high_n, "rate_n_s": self.rate_n_s}
        of_way = {"low_mm": self.low_mm, "high_mm": self.high_mm, "speed_mm_s": self.speed_mm_s}
        given = [[name for name, value in keys.items() if value is not None] for keys in (of_load, of_way)]
        if [len(names) for names in given] not in ([3, 0], [0, 3]):
            raise ValueError(
                f"{', '.join(of_load)}, or {', '.join(of_way)} are expected, got "
                f"{', '.join(given[0] + given[1]) or 'none of them'}"
            )
        low, high = self.ends
        if not low < high:
            raise ValueError(f"the lower end must be below the higher end, got {low:g} and {high:g}")
        return self

    @property
    def ends(self) -> tuple[float, float]:
        """The lower and the higher end, in N or mm."""
        low = self.low_n if self.low_mm is None else self.low_mm
        high = self.high_n if self.high_mm is None else self.high_mm
        assert low is not None
        assert high is not None
        return low, high

    def compile(self, draft: Draft) -> None:
        """Add the cycles."""
        low, high = self.ends
        quantity: Quantity = "load" if self.rate_n_s is not None else "displacement"
        outer = low if abs(low) > abs(high) and draft.may_push(quantity) else high
        if self.rate_n_s is not None:
            move = draft.move_to("load", high, self.rate_n_s)
            draft.move_to("load", low, self.rate_n_s)
            draft.push("load", low)
            draft.expect(abs(outer))
            draft.ranges_n.append(high - low)
        else:
            assert self.speed_mm_s is not None
            move = draft.move_to("displacement", high, self.speed_mm_s)
            draft.move_to("displacement", low, self.speed_mm_s)
        draft.check_increment("the difference of both ends", high - low, move)
        until = self.until
        ending = (
            None
            if until is None
            else draft.load_drop(until.load_drop, until.if_never, math.copysign(1.0, outer))
        )
        draft.add(Cycling(move, low, high, self.count, self.images.every_cycles, ending, outer))


@dataclass(frozen=True)
class Cycling:
    """The part of a course that cycles between two ends. The first motion goes to the higher end."""

    move: Move
    low: float
    high: float
    count: int
    # images are taken in every cycle whose number is a multiple of this value, and in the first and last
    # cycle
    every_cycles: int = 1
    # the event that ends the cycles. The event is checked at the outer end of every cycle.
    ending: Ending | None = None
    # the end with the larger load: the lower end in compression, and otherwise the higher end
    outer: float = math.nan

    def steps(self, index: int, place: Positions) -> list[ProtocolStep]:
        """Return two steps for each cycle: the motion to the higher end and the motion to the lower end."""
        span = place.of(self.move.quantity)
        steps: list[ProtocolStep] = []
        may_be_over = False
        before = span.farther(self.high)
        for cycle in range(1, self.count + 1):
            images = cycle in (1, self.count) or cycle % self.every_cycles == 0
            for target in (self.high, self.low):
                step = self.move.step(
                    index + len(steps), before, target, conditional=may_be_over, images=images
                )
                steps.append(step)
                before = target
                if self.ending is not None and target == self.outer:
                    may_be_over = may_be_over or self.ending.criterion.can_end(cycle, step)
        return steps

    def follow(
        self, index: int, place: Positions, reading: RigReading | None, execute: Execute
    ) -> RigReading:
        """Execute all cycles, or end after the cycle in which the criterion is met."""
        assert reading is not None
        peaks = [reading]
        for number, step in enumerate(self._steps_from(index, place, reading)):
            if step.target != self.outer or self.ending is None:
                reading = execute(step)
                continue
            reading = execute(replace(step, event=self.ending.criterion.at_readings()))
            peaks.append(reading)
            if self.ending.has_happened(number // 2 + 1, step, peaks):
                return reading
        if self.ending is not None:
            self.ending.fail(reading)
        return reading

    def _steps_from(self, index: int, place: Positions, reading: RigReading) -> list[ProtocolStep]:
        """Return the steps from the actual start. If it is above the higher end, the first motion unloads."""
        steps = self.steps(index, place)
        start = reading.of(self.move.quantity)
        if start > self.high + self.move.tolerance:
            first = self.move.step(index, start, self.high, conditional=False, images=steps[0].images)
            steps[0] = first
        return steps

    def end(self, place: Positions) -> Positions:
        """Return the possible positions after the cycles.

        The position is the lower end. With an ending event, it is any position between both ends.
        """
        after = place.after(self.move.quantity, self.low)
        return after if self.ending is None else after.after(self.move.quantity, self.high, early=True)
