"""The part of a course that cycles between two loads or two displacements."""

from dataclasses import dataclass, replace

from rig.protocol.course import Place
from rig.protocol.move import Ending, Move, has_ended
from rig.protocol.step import Execute, ProtocolStep, Reading


@dataclass(frozen=True)
class Cycles:
    """Cycles between two loads or two displacements. The first motion goes to the higher end.

    Attributes
    ----------
    move : Move
    low, high : float
    count : int
    every_cycles : int
        Images are taken in every cycle whose number is a multiple of this value, and in the first and last
        cycle.
    ending : Ending or None
        The event that ends the cycles. The event is checked at the higher end of every cycle.
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
            if has_ended(self.ending, number // 2 + 1, step, peaks):
                return reading
        if self.ending is not None and self.ending.failure is not None:
            raise self.ending.failure(reading)
        return reading

    def _steps_from(self, index: int, place: Place, reading: Reading) -> list[ProtocolStep]:
        """Return the steps from the actual start. If it is above the higher end, the first motion unloads."""
        steps = self.steps(index, place)
        start = reading.of(self.move.quantity)
        if start > self.high + self.move.tolerance:
            first = self.move.step(index, start, self.high, conditional=False, images=steps[0].images)
            steps[0] = first
        return steps

    def end(self, place: Place) -> Place:
        """Return the possible positions after the cycles.

        The position is the lower end. With an ending event, it is any position between both ends.
        """
        after = place.after(self.move.quantity, self.low)
        return after if self.ending is None else after.after(self.move.quantity, self.high, early=True)
