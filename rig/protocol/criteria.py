"""What ends a phase: a criterion such as a drop of the load. `plasticity` has the criterion of the paper."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from rig.protocol.step import ProtocolStep, RigReading


class Criterion(Protocol):
    """Decides after each step of a phase whether the phase ends."""

    def can_end(self, number: int, step: ProtocolStep) -> bool:
        """Return True if the criterion can be checked after a step. The phase's first step has `number` 1."""

    def is_met(self, readings: Sequence[RigReading]) -> bool:
        """Return True if the last reading meets the criterion. The first one was taken before the phase."""

    def at_readings(self) -> Callable[[RigReading], bool] | None:
        """Return a function that checks every reading of a motion and returns True when the criterion is met.

        Return None if the criterion can be checked only after a step.
        """

    def describe(self) -> str:
        """Return a description of the criterion for an error message."""


@dataclass(frozen=True)
class LoadDropCriterion:
    """The criterion that the load has fallen by a fraction of the highest load of the phase.

    During a motion a drop counts only if the load has reached `carried_n`. So noise and seating grips end no
    phase.
    """

    fraction: float
    carried_n: float

    def can_end(self, number: int, _: ProtocolStep) -> bool:
        """Return True, because the load can drop during any step."""
        return True

    def is_met(self, readings: Sequence[RigReading]) -> bool:
        """Return True if the last load has fallen by the fraction."""
        highest_n = max(reading.load_n for reading in readings[1:])
        return readings[-1].load_n < (1.0 - self.fraction) * highest_n

    def at_readings(self) -> Callable[[RigReading], bool]:
        """Return a function that compares each reading with the highest load of the motion."""
        highest_n = -math.inf

        def has_dropped(reading: RigReading) -> bool:
            nonlocal highest_n
            highest_n = max(highest_n, reading.load_n)
            return highest_n >= self.carried_n and reading.load_n < (1.0 - self.fraction) * highest_n

        return has_dropped

    def describe(self) -> str:
        """Return a description of this criterion for an error message."""
        return f"a drop of the load by {self.fraction:g} of the highest load"
