"""The parts of a course that move or hold the specimen: motion to a target, hold, and cycles."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from dic.runfile.schema import StepKind
from rig.errors import ProtocolError
from rig.protocol.course import Place, increments
from rig.protocol.criteria import Criterion
from rig.protocol.step import Execute, LoadDrop, ProtocolStep, Quantity, Reading

Failure = Callable[[Reading], ProtocolError]
"""Type of a function that makes the error for a phase in which the expected event never happened."""


@dataclass(frozen=True)
class Ending:
    """The event that ends a phase early.

    Attributes
    ----------
    criterion : Criterion
    failure : callable or None
        Makes the error if the event never happens; None if the test continues with the next phase then.
    """

    criterion: Criterion
    failure: Failure | None = None


@dataclass(frozen=True)
class Move:
    """The quantity that a motion changes, its rate and its settling tolerance.

    Attributes
    ----------
    quantity : str
        "load", "displacement" or "rotation"; also the kind of the steps.
    rate : float
        In N/s or mm/s; NaN for a rotation.
    tolerance : float
        Settle tolerance in N, mm or deg.
    is_timed : bool
        True if a step may take the planned time of its motion in addition to `settle.timeout_s`.
    """

    quantity: Quantity
    rate: float
    tolerance: float
    is_timed: bool = True

    def duration_s(self, travel: float) -> float:
        """Return the planned duration of a motion in s; 0 if the rate is unknown."""
        return 0.0 if math.isnan(self.rate) else travel / self.rate

    def step(
        self, index: int, start: float, target: float, *, conditional: bool, images: bool = True
    ) -> ProtocolStep:
        """Return the protocol step that moves from `start` to `target`."""
        travel = abs(target - start)
        falls = target < start and self.quantity != "rotation"
        drop: LoadDrop = "commanded" if falls else "break"
        return ProtocolStep(
            index,
            self.quantity,
            target,
            self.tolerance,
            self.rate,
            conditional,
            images=images,
            travel=travel,
            motion_s=self.duration_s(travel) if self.is_timed else 0.0,
            load_drop=drop,
        )


_NEAR_START = 2.0
_NEAR_HOLD: dict[Quantity, float] = {"load": 2.0, "displacement": 0.5}
"""A measured value counts as the commanded one up to so many tolerances from it. A hold of the displacement
commands nothing, so that its readings would leave the tolerance of a target near its end."""


def _commanded_or_measured(place: Place, move: Move, reading: Reading, tolerances: float) -> float:
    """Return the value at which a part of the course begins.

    The commanded value is not the actual one if the motion to it was left out.
    """
    span, measured = place.of(move.quantity), reading.of(move.quantity)
    is_there = span.is_known and not abs(measured - span.low) > tolerances * move.tolerance
    return span.low if is_there else measured


def _has_ended(ending: Ending, number: int, step: ProtocolStep, readings: Sequence[Reading]) -> bool:
    """Return True if the event that ends a phase has happened up to the last of the readings."""
    if readings[-1].ends_phase:
        return True
    return ending.criterion.can_end(number, step) and ending.criterion.is_met(readings)


@dataclass(frozen=True)
class Approach:
    """The motion to a load, a displacement or an angle, in one or several increments.

    The motion stops and settles after each increment; or it continues while images are taken at equal
    intervals of time.

    Attributes
    ----------
    move : Move
    target : float
    increment : float
        Size of an increment; infinite for a motion in one step.
    every_s : float
        Time in s between images during the motion; infinite if images are taken only at rest.
    down : bool
        True if the target is below the start.
    images : bool
        False for a motion without images.
    ending : Ending or None
        The event that ends the motion before its target.
    goes_back : bool
        True if a motion outwards goes back to a target that has been passed already. Otherwise such a motion
        is left out, because moving back would unload the specimen.
    refusal : callable or None
        Makes the error that ends the run if the target has been passed already.
    """

    move: Move
    target: float
    increment: float = math.inf
    every_s: float = math.inf
    down: bool = False
    images: bool = True
    ending: Ending | None = None
    goes_back: bool = False
    refusal: Failure | None = None

    def steps(self, index: int, place: Place) -> list[ProtocolStep]:
        """Return the steps of the motion from the start that is farthest from the target."""
        span = place.of(self.move.quantity)
        start = span.high if self.down else span.low
        steps = self._from(index, start, conditional=not span.is_known)
        # The target may have been passed at any start that is not known.
        return steps or [self._back(index, start)]

    def follow(self, index: int, place: Place, reading: Reading | None, execute: Execute) -> Reading:
        """Execute the steps from the actual start to the target, or until the criterion is met."""
        assert reading is not None
        span = place.of(self.move.quantity)
        start = _commanded_or_measured(place, self.move, reading, _NEAR_START)
        steps = self._from(index, start, conditional=not span.is_known)
        if self._is_passed(start):
            reading = self._pass(index + len(self.steps(index, place)) - 1, reading, start, execute)
        if self.every_s < math.inf and steps:
            # The last step has the number from the plan, even if fewer steps were needed before it.
            last = index + len(self.steps(index, place)) - 1
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
            if ending and _has_ended(ending, number, step, readings):
                return reading
        if self.ending is not None and self.ending.failure is not None:
            raise self.ending.failure(reading)
        return reading

    def end(self, place: Place) -> Place:
        """Return the place at the target, or anywhere on the way if a criterion can end the motion."""
        return place.after(self.move.quantity, self.target, early=self.ending is not None)

    def _is_passed(self, start: float) -> bool:
        beyond = self.target - start if self.down else start - self.target
        return self.move.quantity != "rotation" and beyond > self.move.tolerance

    def _pass(self, index: int, reading: Reading, start: float, execute: Execute) -> Reading:
        """Leave the motion out, or go back to the target, or raise the error of `refusal`."""
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
        if self.every_s < math.inf:
            return self._timed(index, start, conditional=conditional)
        steps: list[ProtocolStep] = []
        may_be_over = conditional
        targets = self._targets(start)
        for number, (before, target) in enumerate(zip([start, *targets], targets, strict=False), 1):
            step = self.move.step(
                index + number - 1, before, target, conditional=may_be_over, images=self.images
            )
            steps.append(step)
            may_be_over = may_be_over or self._can_end(number, step)
        return steps

    def _timed(self, index: int, start: float, *, conditional: bool) -> list[ProtocolStep]:
        """Return the steps with images during the motion, and the last step, which settles at the target."""
        if not self._targets(start):
            return []
        whole = self.move.step(index, start, self.target, conditional=conditional)
        count = max(0, math.ceil(self.move.duration_s(whole.travel) / self.every_s) - 1)
        steps: list[ProtocolStep] = []
        may_be_over = conditional
        for number in range(1, count + 2):
            at_s = math.nan if number > count else number * self.every_s
            left = whole.travel - (number - 1) * self.every_s * self.move.rate
            step = ProtocolStep(
                index + number - 1,
                whole.kind,
                whole.target,
                whole.tolerance,
                whole.rate,
                may_be_over,
                at_s,
                begins=number == 1,
                travel=min(left, self.every_s * self.move.rate) if number <= count else left,
                motion_s=whole.motion_s,
                load_drop=whole.load_drop,
            )
            steps.append(step)
            may_be_over = may_be_over or self._can_end(number, step)
        return steps

    def _targets(self, start: float) -> list[float]:
        if self.increment == math.inf:
            way = start - self.target if self.down else self.target - start
            return [self.target] if way > self.move.tolerance else []
        return increments(start, self.target, self.increment, self.move.tolerance, down=self.down)

    def _can_end(self, number: int, step: ProtocolStep) -> bool:
        return self.ending is not None and self.ending.criterion.can_end(number, step)


@dataclass(frozen=True)
class Hold:
    """A hold for a time, at constant load (creep), displacement (relaxation) or angle (rest).

    Attributes
    ----------
    move : Move or None
        The held quantity; a load that leaves its tolerance is commanded again at the rate of `move`. None for
        a rest.
    duration_s, every_s : float
        Duration of the hold, and time between images, in s. The last images are taken at the end of the hold.
    """

    move: Move | None
    duration_s: float
    every_s: float = math.inf

    def steps(self, index: int, place: Place) -> list[ProtocolStep]:
        """Return one step for each time at which images are taken."""
        if self.move is None:
            return self._at(index, math.nan)
        span = place.of(self.move.quantity)
        return self._at(index, span.low if span.is_known else math.nan)

    def follow(self, index: int, place: Place, reading: Reading | None, execute: Execute) -> Reading:
        """Execute all steps; the target is the load or displacement commanded or measured before the hold."""
        assert reading is not None
        target = math.nan
        if self.move is not None:
            target = _commanded_or_measured(place, self.move, reading, _NEAR_HOLD[self.move.quantity])
        for step in self._at(index, target):
            reading = execute(step)
        return reading

    def end(self, place: Place) -> Place:
        """Return the place after the hold: a constant load leaves the displacement unknown, and vice
        versa."""
        if self.move is None:
            return place
        span = place.of(self.move.quantity)
        after = place.after(self.move.quantity, span.low)
        return after if span.is_known else place

    def _at(self, index: int, target: float) -> list[ProtocolStep]:
        move = self.move
        kinds: dict[Quantity, StepKind] = {"load": "creep", "displacement": "relaxation"}
        times_s = [
            *(number * self.every_s for number in range(1, self._count())),
            self.duration_s,
        ]
        return [
            ProtocolStep(
                index + number,
                "rest" if move is None else kinds[move.quantity],
                target,
                math.nan if move is None else move.tolerance,
                math.nan if move is None else move.rate,
                at_s=at_s,
                begins=number == 0,
                load_drop="slow",
            )
            for number, at_s in enumerate(times_s)
        ]

    def _count(self) -> int:
        return 1 if self.every_s == math.inf else max(1, math.ceil(self.duration_s / self.every_s - 1e-9))


@dataclass(frozen=True)
class Cycles:
    """Cycles between two loads or two displacements; the first motion goes to the higher one.

    Attributes
    ----------
    move : Move
    low, high : float
    count : int
    every_cycles : int
        Images are taken in every cycle whose number is a multiple of this value, and in the first and last
        cycle.
    ending : Ending or None
        The event that ends the cycles; it is checked at the higher end of every cycle.
    """

    move: Move
    low: float
    high: float
    count: int
    every_cycles: int = 1
    ending: Ending | None = None

    def steps(self, index: int, place: Place) -> list[ProtocolStep]:
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
                if self.ending is not None and target == self.high:
                    may_be_over = may_be_over or self.ending.criterion.can_end(cycle, step)
        return steps

    def follow(self, index: int, place: Place, reading: Reading | None, execute: Execute) -> Reading:
        """Execute all cycles, or end after the cycle in which the criterion is met."""
        assert reading is not None
        peaks = [reading]
        for number, step in enumerate(self._steps_from(index, place, reading)):
            is_pull = number % 2 == 0
            if not is_pull or self.ending is None:
                reading = execute(step)
                continue
            reading = execute(replace(step, event=self.ending.criterion.at_readings()))
            peaks.append(reading)
            if _has_ended(self.ending, number // 2 + 1, step, peaks):
                return reading
        if self.ending is not None and self.ending.failure is not None:
            raise self.ending.failure(reading)
        return reading

    def _steps_from(self, index: int, place: Place, reading: Reading) -> list[ProtocolStep]:
        """Return the steps from the actual start; from beyond the higher end, the first motion unloads."""
        steps = self.steps(index, place)
        start = reading.of(self.move.quantity)
        if start > self.high + self.move.tolerance:
            first = self.move.step(index, start, self.high, conditional=False, images=steps[0].images)
            steps[0] = first
        return steps

    def end(self, place: Place) -> Place:
        """Return the place at the lower end, or between both ends if a criterion can end the cycles."""
        after = place.after(self.move.quantity, self.low)
        return after if self.ending is None else after.after(self.move.quantity, self.high, early=True)
