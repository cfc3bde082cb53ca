"""The part of a course that moves the specimen to a target."""

import math
from dataclasses import dataclass, replace
from itertools import pairwise

from rig.protocol.course import Positions, increments
from rig.protocol.move import Ending, Failure, Move, commanded_or_measured
from rig.protocol.step import Execute, ProtocolStep, RigReading, at_times

_NEAR_START = 2.0
"""A motion starts from the commanded value if the measured value differs by at most this many tolerances."""


@dataclass(frozen=True)
class Approach:
    """The motion to a load, a displacement or an angle, in one or several increments.

    The motion stops and settles after each increment, or it continues while images are taken at equal
    intervals of time.
    """

    move: Move
    target: float
    increment: float = math.inf  # size of an increment, which is infinite for a motion in one step
    # time in s between images during the motion, which is infinite if images are taken only at rest
    every_s: float = math.inf
    down: bool = False  # True if the target is below the start
    images: bool = True  # False for a motion without images
    ending: Ending | None = None  # the event that ends the motion before its target
    # what happens to a motion to a higher value if its target has been passed before it starts. If True, it
    # goes back to the target. If False, it is left out, because moving back would unload the specimen.
    goes_back: bool = False
    refusal: Failure | None = None  # makes the error that ends the run if the target has been passed already

    def steps(self, index: int, place: Positions) -> list[ProtocolStep]:
        """Return the steps of the motion from that possible start which is farthest from the target."""
        span = place.of(self.move.quantity)
        start = span.high if self.down else span.low
        steps = self._from(index, start, conditional=not span.is_known)
        # If there are no steps, even this start is beyond the target. Then plan one step back to the target.
        return steps or [self._back(index, start)]

    def follow(
        self, index: int, place: Positions, reading: RigReading | None, execute: Execute
    ) -> RigReading:
        """Execute the steps from the actual start to the target, or until the criterion is met."""
        assert reading is not None
        span = place.of(self.move.quantity)
        start = commanded_or_measured(place, self.move, reading, _NEAR_START)
        steps = self._from(index, start, conditional=not span.is_known)
        last = index + len(self.steps(index, place)) - 1
        if self._is_passed(start):
            reading = self._pass(last, reading, start, execute)
        if self.every_s < math.inf and steps:
            # Give the last step its number from the plan, even if fewer steps were needed before it.
            steps[-1] = replace(steps[-1], index=last)
        readings = [reading]
        arrived = False
        ending = self.ending
        event = None if ending is None else ending.criterion.at_readings()
        for number, step in enumerate(steps, 1):
            if arrived and step.timed:
                continue
            reading = execute(replace(step, event=event))
            readings.append(reading)
            arrived = step.timed and not reading.moving and step.is_reached(reading)
            if ending and ending.has_happened(number, step, readings):
                return reading
        if ending is not None:
            ending.fail(reading)
        return reading

    def end(self, place: Positions) -> Positions:
        """Return the possible positions after the motion: the target or, with an event, any on the way."""
        return place.after(self.move.quantity, self.target, early=self.ending is not None)

    def _is_passed(self, start: float) -> bool:
        beyond = self.target - start if self.down else start - self.target
        return self.move.quantity != "rotation" and beyond > self.move.tolerance

    def _pass(self, index: int, reading: RigReading, start: float, execute: Execute) -> RigReading:
        """Handle a target that has been passed already: leave the motion out, go back, or raise an error."""
        if self.refusal is not None:
            raise self.refusal(reading)
        step = self._back(index, start)
        if self.goes_back:
            return execute(step)
        execute(replace(step, passed=True))
        return reading

    def _back(self, index: int, start: float) -> ProtocolStep:
        return self.move.step(index, start, self.target, conditional=True, images=self.images)

    def _from(self, index: int, start: float, *, conditional: bool) -> list[ProtocolStep]:
        targets, ending = self._targets(start), self.ending
        if self.every_s < math.inf and targets:
            steps = self._timed(index, start)
        else:
            steps = [
                self.move.step(number, before, target, conditional=False, images=self.images)
                for number, (before, target) in enumerate(pairwise([start, *targets]), index)
            ]
        for k, step in enumerate(steps):
            steps[k] = replace(step, conditional=conditional)
            conditional = conditional or (ending is not None and ending.criterion.can_end(k + 1, step))
        return steps

    def _timed(self, index: int, start: float) -> list[ProtocolStep]:
        """Return the steps with images during the motion, and the last step, which settles at the target."""
        whole = self.move.step(index, start, self.target, conditional=False)
        count = max(0, math.ceil(self.move.duration_s(whole.travel) / self.every_s) - 1)
        times_s = [number * self.every_s for number in range(1, count + 1)]
        *others, last = at_times(whole, [*times_s, math.nan])
        return [*others, replace(last, travel=whole.travel - count * self.every_s * self.move.rate)]

    def _targets(self, start: float) -> list[float]:
        if self.increment == math.inf:
            way = start - self.target if self.down else self.target - start
            return [self.target] if way > self.move.tolerance else []
        return increments(start, self.target, self.increment, self.move.tolerance, down=self.down)
