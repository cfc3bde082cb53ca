"""What ends a phase: a criterion such as a drop of the load. `plasticity` has the criterion of the paper."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from rig.protocol.step import PhaseEvent, ProtocolStep, RigReading


class Criterion(Protocol):
    """Decides after each step of a phase whether the phase ends."""

    def can_end(self, number: int, step: ProtocolStep) -> bool:
        """Return True if the criterion can be checked after a step. The phase's first step has `number` 1."""

    def is_met(self, readings: Sequence[RigReading]) -> bool:
        """Return True if the last reading meets the criterion. The first one was taken before the phase."""

    def at_readings(self) -> PhaseEvent | None:
        """Return an event that checks every reading of a motion and happens when the criterion is met.

        Return None if the criterion can be checked only after a step.
        """

    def describe(self) -> str:
        """Return a description of the criterion for an error message."""


@dataclass(frozen=True)
class LoadDropCriterion:
    """The criterion that the load has fallen by a fraction of the highest load of the phase.

    In compression the largest compressive load counts, and `sense` is -1.

    During a motion a drop counts only if the load has reached `carried_n`. So noise and seating grips end no
    phase.
    """

    fraction: float
    carried_n: float
    sense: float = 1.0

    def can_end(self, number: int, _: ProtocolStep) -> bool:
        """Return True, because the load can drop during any step."""
        return True

    def is_met(self, readings: Sequence[RigReading]) -> bool:
        """Return True if the last load has fallen by the fraction."""
        loads_n = [self.sense * reading.load_n for reading in readings[1:]]
        return loads_n[-1] < (1.0 - self.fraction) * max(loads_n)

    def at_readings(self) -> PhaseEvent:
        """Return an event that compares each reading with the highest load of the motion."""
        return _Drop(self)

    def describe(self) -> str:
        """Return a description of this criterion for an error message."""
        return f"a drop of the load by {self.fraction:g} of the highest load"


class _Drop:
    """A drop of the load below the highest load of a motion, as an event of a phase."""

    def __init__(self, criterion: LoadDropCriterion) -> None:
        self._criterion = criterion
        self._highest_n = -math.inf

    def __call__(self, reading: RigReading) -> bool:
        load_n = self._criterion.sense * reading.load_n
        self._highest_n = max(self._highest_n, load_n)
        lowest_n = (1.0 - self._criterion.fraction) * self._highest_n
        return self._highest_n >= self._criterion.carried_n and load_n < lowest_n

    def renew(self) -> None:
        """Determine the highest load again, because the specimen has relaxed in a pause."""
        self._highest_n = -math.inf
