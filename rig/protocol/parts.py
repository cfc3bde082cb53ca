"""The parts of a course that move or hold the specimen: motion to a target, hold, and cycles."""

import math
from collections.abc import Callable
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
    """

    move: Move
    target: float
    increment: float = math.inf
    every_s: float = math.inf
    down: bool = False
    images: bool = True
    ending: Ending | None = None

    def steps(self, index: int, place: Place) -> list[ProtocolStep]:
        """Return the steps of the motion from the start that is farthest from the target."""
        span = place.of(self.move.quantity)
        return self._from(index, span.farther(self.target), conditional=not span.is_known)

    def follow(self, index: int, place: Place, reading: Reading | None, execute: Execute) -> Reading:
        """Execute the steps from the actual start to the target, or until the criterion is met."""
        assert reading is not None
        span = place.of(self.move.quantity)
        start = span.low if span.is_known else reading.of(self.move.quantity)
        steps = self._from(index, start, conditional=not span.is_known)
        if self.every_s < math.inf and steps:
            # The last step has the number from the plan, even if fewer steps were needed before it.
            last = index + len(self.steps(index, place)) - 1
            steps[-1] = replace(steps[-1], index=last)
        readings = [reading]
        arrived = False
        for number, step in enumerate(steps, 1):
            if arrived and step.timed:
                continue
            reading = execute(step)
            readings.append(reading)
            arrived = step.timed and not reading.moving and step.is_reached(reading)
            ending = self.ending
            if ending and ending.criterion.can_end(number, step) and ending.criterion.is_met(readings):
                return reading
        if self.ending is not None and self.ending.failure is not None:
            raise self.ending.failure(reading)
        return reading

    def end(self, place: Place) -> Place:
        """Return the place at the target, or anywhere on the way if a criterion can end the motion."""
        return place.after(self.move.quantity, self.target, early=self.ending is not None)

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
            span = place.of(self.move.quantity)
            target = span.low if span.is_known else reading.of(self.move.quantity)
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
        for number, step in enumerate(self.steps(index, place)):
            reading = execute(step)
            if number % 2 == 0 and self.ending is not None:
                peaks.append(reading)
                criterion = self.ending.criterion
                if criterion.can_end(number // 2 + 1, step) and criterion.is_met(peaks):
                    return reading
        if self.ending is not None and self.ending.failure is not None:
            raise self.ending.failure(reading)
        return reading

    def end(self, place: Place) -> Place:
        """Return the place at the lower end, or between both ends if a criterion can end the cycles."""
        after = place.after(self.move.quantity, self.low)
        return after if self.ending is None else after.after(self.move.quantity, self.high, early=True)
