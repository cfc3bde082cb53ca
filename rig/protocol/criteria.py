"""The criteria that end a phase: plastic deformation, or a drop of the load."""

from collections.abc import Sequence
from typing import Protocol

from pydantic import Field

from drivers.settings import Settings
from rig.protocol.plasticity import PlasticCriterion
from rig.protocol.step import ProtocolStep, Reading


class Criterion(Protocol):
    """Decides after each step of a phase whether the phase ends."""

    def can_end(self, number: int, step: ProtocolStep) -> bool:
        """Return True if the criterion can be checked after a step; `number` counts the phase's steps from
        1."""

    def is_met(self, readings: Sequence[Reading]) -> bool:
        """Return True if the last of the readings meets the criterion; the first was taken before the
        phase."""

    def describe(self) -> str:
        """Return a description of the criterion for an error message."""


class Plastic:
    """Plastic deformation, as `PlasticCriterion` defines it."""

    def __init__(self, settings: PlasticCriterion) -> None:
        self._settings = settings

    def can_end(self, number: int, step: ProtocolStep) -> bool:
        """Return True from the second increment on, at loads above `judged_above_n`."""
        # Compare the commanded load with `judged_above_n`, because the measured load has noise.
        return number >= 2 and step.target > self._settings.judged_above_n

    def is_met(self, readings: Sequence[Reading]) -> bool:
        """Return True if the last load increment is clearly less stiff than the stiffest increment so far."""
        loads_n = [reading.load_n for reading in readings]
        return self._settings.is_evident(loads_n, [reading.displacement_mm for reading in readings])

    def describe(self) -> str:
        """Return a description of this criterion for an error message."""
        return f"an increment of less than {self._settings.stiffness_fraction:g} of the highest stiffness"


class LoadDropCriterion:
    """The criterion that the load has fallen by a fraction of the highest load of the phase.

    Parameters
    ----------
    fraction : float
    """

    def __init__(self, fraction: float) -> None:
        self._fraction = fraction

    def can_end(self, number: int, _: ProtocolStep) -> bool:
        """Return True from the second step on, because a drop needs two loads."""
        return number >= 2

    def is_met(self, readings: Sequence[Reading]) -> bool:
        """Return True if the last load has fallen by the fraction."""
        highest_n = max(reading.load_n for reading in readings[1:])
        return readings[-1].load_n < (1.0 - self._fraction) * highest_n

    def describe(self) -> str:
        """Return a description of this criterion for an error message."""
        return f"a drop of the load by {self._fraction:g} of the highest load"


class Until(Settings):
    """The table `until` of a phase. Exactly one criterion is given. `if_never` says what happens if the
    criterion is never met."""

    plastic: PlasticCriterion | None = None
    load_drop: float | None = Field(default=None, gt=0.0, lt=1.0)
    if_never: str = Field(default="fail", pattern="^(fail|go-on)$")

    def criterion(self) -> Criterion | None:
        """Return the criterion that the table gives."""
        if self.plastic is not None:
            return Plastic(self.plastic)
        return None if self.load_drop is None else LoadDropCriterion(self.load_drop)
