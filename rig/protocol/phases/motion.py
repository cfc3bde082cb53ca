"""What the phases that move the load frame to a target share: images, early ends, the approach."""

import math
from abc import ABC, abstractmethod
from dataclasses import replace
from typing import Literal, Self, TypeAlias

from pydantic import Field, model_validator

from drivers.settings import Settings
from rig.errors import ProtocolError
from rig.protocol.approach import Approach
from rig.protocol.draft import Draft, IfNever, Increment, Phase
from rig.protocol.move import Ending, Move
from rig.protocol.plasticity import PlasticCriterion
from rig.protocol.step import UNITS

IfPassed: TypeAlias = Literal["go-on", "go-back", "fail"]
"""What a motion to a higher value does if its target has been passed already: the phase is left out, the
motion goes back to the target, or the run ends."""


class MotionImages(Settings, ABC):
    """The times of images during a motion of the load frame. By default they are taken once, at the end."""

    every_s: float | None = Field(default=None, gt=0.0, description="time between images during the motion")
    never: bool = False

    @property
    @abstractmethod
    def increment(self) -> float | None:
        """The increment after which the motion stops and settles, in the unit of its target."""

    @model_validator(mode="after")
    def _one(self) -> Self:
        _at_most_one(self, *sorted(type(self).model_fields))
        return self


class LoadImages(MotionImages):
    """The times of images during a motion to a load."""

    every_n: Increment = None

    @property
    def increment(self) -> float | None:
        """The increment in N."""
        return self.every_n


class Until(Settings):
    """The event that ends a phase before its target. Exactly one criterion is given."""

    plastic: PlasticCriterion | None = None
    load_drop: float | None = Field(default=None, gt=0.0, lt=1.0)
    if_never: IfNever = "fail"

    @model_validator(mode="after")
    def _exactly_one(self) -> Self:
        _at_most_one(self, "plastic", "load_drop")
        if self.plastic is None and self.load_drop is None:
            raise ValueError("plastic or load_drop is expected; add one of them")
        return self

    def ending(self, draft: Draft, sense: float) -> Ending:
        """Return the event for a draft. `sense` is 1 in tension and -1 in compression."""
        if self.plastic is not None:
            return draft.ending(self.plastic, self.if_never)
        assert self.load_drop is not None
        return draft.load_drop(self.load_drop, self.if_never, sense)


class Pulling(Phase):
    """A motion to a higher load or displacement, in tension or, with a negative target, in compression."""

    until: Until | None = None
    if_passed: IfPassed = "go-on"

    def approach(self, draft: Draft, move: Move, target: float, images: MotionImages) -> Approach:
        """Return the part of the course, after checks."""
        draft.push(move.quantity, target)
        ending = None if self.until is None else self.until.ending(draft, math.copysign(1.0, target))
        part = approach(draft, move, target, images, ending, down=target < 0.0)
        if move.quantity == "load":
            every_n = images.increment
            draft.increments_n.append(abs(target) if every_n is None else every_n)
        if self.if_passed != "fail":
            return replace(part, goes_back=self.if_passed == "go-back")
        where, unit = draft.where, UNITS[move.quantity]
        return replace(
            part,
            refusal=lambda reading: ProtocolError(
                where,
                f"a {move.quantity} {'above' if part.down else 'below'} {target:g} {unit}, so that the "
                f"motion {'pushes' if part.down else 'pulls'}",
                f"{reading.of(move.quantity):.6g} {unit}",
                'go farther in this phase, or set if_passed = "go-on" or "go-back"',
            ),
        )


def approach(
    draft: Draft,
    move: Move,
    target: float,
    images: MotionImages,
    ending: Ending | None = None,
    *,
    down: bool = False,
) -> Approach:
    """Return the motion of the load frame to a target, and note its mistakes."""
    span, unit, increment = draft.place.of(move.quantity), UNITS[move.quantity], images.increment
    bound = span.high if down else span.low
    beyond = target >= bound if down else target <= bound
    if beyond and (span.is_known or down):
        way, away = ("below", target < 0.0) if down else ("above", target > 0.0)
        other = "unload" if away else "to-load"
        if move.quantity == "displacement":
            other = "unload or cycles"
        draft.mistake(
            f"a target {way} {bound:g} {unit}, where the phase starts, is expected, got {target:g}; "
            f"use {other} for the other direction"
        )
    if increment is not None:
        draft.check_increment(f"images.every_{unit.lower()}", increment, move)
    judged_at_readings = ending is None or ending.criterion.at_readings() is not None
    if not judged_at_readings and increment is None and images.every_s is None:
        draft.mistake(
            "until.plastic needs images at increments or times, because it compares stiffnesses between "
            "images; add images.every_n or images.every_s"
        )
    return Approach(
        move,
        target,
        math.inf if increment is None else increment,
        math.inf if images.every_s is None else images.every_s,
        down,
        images=not images.never,
        ending=ending,
    )


def _at_most_one(table: Settings, *names: str) -> None:
    given = [name for name in names if getattr(table, name) not in (None, False)]
    if len(given) > 1:
        raise ValueError(f"only one of {' and '.join(given)} is expected; remove the others")
