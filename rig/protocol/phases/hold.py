"""The phase `hold`: a load, a displacement or an angle is held for a time."""

import math
from dataclasses import dataclass, replace
from typing import Literal, Self

from pydantic import Field, model_validator

from dic.runfile.schema import StepKind
from drivers.settings import Settings
from rig.protocol.course import Positions
from rig.protocol.draft import HOURS_MAX, Draft, Phase
from rig.protocol.move import Move, commanded_or_measured
from rig.protocol.step import Execute, ProtocolStep, Quantity, RigReading, at_times

_SECONDS_MAX = HOURS_MAX * 3600.0
_NEAR_HOLD: dict[Quantity, float] = {"load": 2.0, "displacement": 0.5}
"""A hold keeps the commanded value if the measured value differs by at most this number of tolerances.

Otherwise the hold keeps the measured value. The number for displacement is small, because a hold of the
displacement sends no command. With a larger number, the readings could leave the tolerance of the commanded
value.
"""


class HoldImages(Settings):
    """The times of images during a hold. Images are always taken at its end."""

    every_s: float | None = Field(
        default=None, gt=0.0, description="time between images, counted from the start of the hold"
    )


class Hold(Phase):
    """A hold at constant load (creep), displacement (relaxation) or angle (rest)."""

    do: Literal["hold"]
    keep: Literal["load", "displacement", "angle"]
    duration_s: float = Field(gt=0.0, le=_SECONDS_MAX)
    rate_n_s: float | None = Field(
        default=None, gt=0.0, description="rate at which a load that drifts is corrected"
    )
    images: HoldImages = HoldImages()

    @model_validator(mode="after")
    def _rate_with_load(self) -> Self:
        if self.keep == "load" and self.rate_n_s is None:
            raise ValueError("rate_n_s is missing; add it, because a load that drifts is corrected at a rate")
        if self.keep != "load" and self.rate_n_s is not None:
            raise ValueError('rate_n_s belongs to keep = "load" only; remove it')
        return self

    def compile(self, draft: Draft) -> None:
        """Add the hold."""
        quantity: Quantity = "rotation" if self.keep == "angle" else self.keep
        move = draft.move(quantity, self.rate_n_s or math.nan)
        every_s = math.inf if self.images.every_s is None else self.images.every_s
        draft.add(Holding(None if quantity == "rotation" else move, self.duration_s, every_s))


@dataclass(frozen=True)
class Holding:
    """The part of a course that holds a load, a displacement or an angle for a time."""

    # the held quantity, or None for a rest. A load that leaves its tolerance is commanded again at the rate
    # of `move`.
    move: Move | None
    # duration of the hold, and time between images, in s. The last images are taken at the end of the hold.
    duration_s: float
    every_s: float = math.inf

    def steps(self, index: int, place: Positions) -> list[ProtocolStep]:
        """Return one step for each time at which images are taken."""
        if self.move is None:
            return self._at(index, math.nan)
        span = place.of(self.move.quantity)
        return self._at(index, span.low if span.is_known else math.nan)

    def follow(
        self, index: int, place: Positions, reading: RigReading | None, execute: Execute
    ) -> RigReading:
        """Execute all steps, whose target is the value that was commanded or measured before the hold."""
        assert reading is not None
        target = math.nan
        if self.move is not None:
            target = commanded_or_measured(place, self.move, reading, _NEAR_HOLD[self.move.quantity])
        for step in self._at(index, target):
            reading = execute(step)
        return reading

    def end(self, place: Positions) -> Positions:
        """Return the possible positions after the hold. At a constant load, any displacement is possible."""
        if self.move is None:
            return place
        span = place.of(self.move.quantity)
        after = place.after(self.move.quantity, span.low)
        return after if span.is_known else place

    def _at(self, index: int, target: float) -> list[ProtocolStep]:
        move = self.move
        kinds: dict[Quantity, StepKind] = {"load": "creep", "displacement": "relaxation"}
        times_s = [*(number * self.every_s for number in range(1, self._count())), self.duration_s]
        first = ProtocolStep(index, "rest", target, load_drop="slow")
        if move is not None:
            kind = kinds[move.quantity]
            first = replace(first, kind=kind, tolerance=move.tolerance, rate=move.rate)
        return at_times(first, times_s)

    def _count(self) -> int:
        return 1 if self.every_s == math.inf else max(1, math.ceil(self.duration_s / self.every_s - 1e-9))
