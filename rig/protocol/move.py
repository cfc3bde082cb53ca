"""A motion between two values of one quantity, and the event that ends a phase early."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from rig.errors import ProtocolError
from rig.protocol.course import Positions
from rig.protocol.criteria import Criterion
from rig.protocol.step import LoadDrop, ProtocolStep, Quantity, RigReading

Failure = Callable[[RigReading], ProtocolError]
"""Type of a function that makes the error for a phase in which the expected event never happened."""


@dataclass(frozen=True)
class Ending:
    """The event that ends a phase early."""

    criterion: Criterion
    # makes the error if the event never happens. None if the test then continues with the next phase.
    failure: Failure | None = None

    def has_happened(self, number: int, step: ProtocolStep, readings: Sequence[RigReading]) -> bool:
        """Return True if the event has happened at or before the last reading of a step."""
        criterion = self.criterion
        return readings[-1].ends_phase or (criterion.can_end(number, step) and criterion.is_met(readings))

    def fail(self, reading: RigReading) -> None:
        """Raise the error for a phase that is over, unless the test continues."""
        if self.failure is not None:
            raise self.failure(reading)


@dataclass(frozen=True)
class Move:
    """The quantity that a motion changes, its rate and its settling tolerance."""

    quantity: Quantity  # "load", "displacement" or "rotation". The steps have the same kind.
    rate: float  # in N/s or mm/s, or NaN for a rotation
    tolerance: float  # settle tolerance in N, mm or deg
    # True if a step may take longer than `settle.timeout_s`, by the planned time of its motion
    is_timed: bool = True

    def duration_s(self, travel: float) -> float:
        """Return the planned duration of a motion in s, or 0 if the rate is unknown."""
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


def commanded_or_measured(place: Positions, move: Move, reading: RigReading, tolerances: float) -> float:
    """Return the commanded value if the measured value is near it, otherwise the measured value.

    A part of the course begins at this value. The measured value can be far from the commanded value if the
    motion to the commanded value was left out.
    """
    span, measured = place.of(move.quantity), reading.of(move.quantity)
    is_there = span.is_known and not abs(measured - span.low) > tolerances * move.tolerance
    return span.low if is_there else measured
