"""The course of a test. Each part of a course lists its possible steps for the plan, and executes steps.

Every protocol is compiled to a course, and the engine executes the steps of this course.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Protocol

from rig.errors import ProtocolError
from rig.protocol.images import Images
from rig.protocol.step import Execute, ProtocolStep, Quantity, RigReading, at_times
from rig.protocol.tables import Limits


@dataclass(frozen=True)
class Span:
    """The range of values that load, displacement or angle can have before a part of the course.

    If the value was commanded, it is known, and `low` equals `high`.
    """

    low: float
    high: float

    @property
    def is_known(self) -> bool:
        """True if the value is known, because it was commanded."""
        return self.low == self.high

    def farther(self, target: float) -> float:
        """Return the end of the range that is farther from a target, or the lower end if both are equally
        far."""
        return self.low if abs(target - self.low) >= abs(target - self.high) else self.high


@dataclass(frozen=True)
class Positions:
    """The possible positions of the devices before a part of the course."""

    # the range of possible values of each quantity, in N, mm and degrees
    load: Span = Span(0.0, 0.0)
    displacement: Span = Span(0.0, 0.0)
    rotation: Span = Span(0.0, 0.0)
    # the ranges of load and displacement. A value that is not known lies within its range.
    loads: Span = Span(0.0, 0.0)
    displacements: Span = Span(0.0, 0.0)

    @classmethod
    def within(cls, limits: Limits | None) -> "Positions":
        """Return the place before a test, where all quantities are zero, with the limits of a protocol.

        A value that is not known is in compression only if the protocol declares a limit of compression.
        """
        if limits is None:
            return cls()
        return cls(
            loads=Span(limits.load_min_n or 0.0, limits.load_max_n),
            displacements=Span(limits.displacement_min_mm or 0.0, limits.displacement_max_mm),
        )

    def of(self, quantity: Quantity) -> Span:
        """Return the range of possible values of a quantity."""
        return {"load": self.load, "displacement": self.displacement, "rotation": self.rotation}[quantity]

    def after(self, quantity: Quantity, value: float, *, early: bool = False) -> "Positions":
        """Return the possible positions after a motion to `value`. With `early`, the motion may end early."""
        before = self.of(quantity)
        span = Span(min(before.low, value), max(before.high, value)) if early else Span(value, value)
        if quantity == "rotation":
            return replace(self, rotation=span)
        if quantity == "load":
            return replace(self, load=span, displacement=self.displacements)
        return replace(self, displacement=span, load=self.loads)


class CoursePart(Protocol):
    """Interface of a part of a course, such as the motion to a load, with a known largest number of steps."""

    def steps(self, index: int, place: Positions) -> list[ProtocolStep]:
        """Return all steps that this part may need. The first step has the number `index`."""

    def follow(
        self, index: int, place: Positions, reading: RigReading | None, execute: Execute
    ) -> RigReading:
        """Execute the steps that are needed according to the readings, and return the last reading."""

    def end(self, place: Positions) -> Positions:
        """Return the possible positions of the devices after this part."""


@dataclass(frozen=True)
class Course:
    """The parts of a test in their order."""

    parts: tuple[CoursePart, ...]
    start: Positions

    def steps(self) -> list[ProtocolStep]:
        """Return the steps of the longest possible test."""
        return [step for _, _, _, steps in self._walk() for step in steps]

    def follow(self, execute: Execute) -> None:
        """Call `execute` for each step, in order. The settled readings decide how many steps are executed.

        Raise `ProtocolError` if a phase reaches its target, but the event that should end it never happened.
        """
        reading: RigReading | None = None
        for part, index, place, steps in self._walk():
            last = index + len(steps)

            def execute_planned(step: ProtocolStep, last: int = last) -> RigReading:
                if step.index >= last:
                    raise ProtocolError(
                        str(step),
                        f"at most the {last} steps of the plan up to this phase",
                        "more increments than from zero to the target",
                        "zero the load frame with the specimen at rest, then start the protocol again",
                    )
                return execute(step)

            reading = part.follow(index, place, reading, execute_planned)

    def _walk(self) -> Iterator[tuple[CoursePart, int, Positions, list[ProtocolStep]]]:
        index, place = 0, self.start
        for part in self.parts:
            steps = part.steps(index, place)
            yield part, index, place, steps
            index, place = index + len(steps), part.end(place)


def increments(
    start: float, total: float, increment: float, tolerance: float, *, down: bool = False
) -> list[float]:
    """Return the targets from `start` in equal increments. The last target is `total` itself.

    A remainder of at most `tolerance` is added to the last increment. If `start` is already beyond `total`,
    there are no targets.

    Examples
    --------
    >>> increments(4.2, 5.0, 0.3, 0.002)
    [4.5, 4.8, 5.0]
    >>> increments(3.0, 1.0, 1.0, 0.1, down=True)
    [2.0, 1.0]
    """
    sign = -1.0 if down else 1.0
    count = math.ceil((sign * (total - start) - tolerance) / increment)
    return [start + i * sign * increment for i in range(1, count)] + ([total] if count > 0 else [])


@dataclass(frozen=True)
class Beginning:
    """The first part of every course: images of the grid, reference images, and still images after them.

    The reference images are taken with or without a preload.
    """

    # number of still images, and time between them, in s
    still: int = 0
    still_every_s: float = 1.0
    # the step of the reference images. The index of this step is set when the steps are listed.
    reference: ProtocolStep = field(default_factory=lambda: ProtocolStep(1, "reference"))
    grid: bool = True
    has_reference: bool = True

    @classmethod
    def of(cls, images: Images) -> "Beginning":
        """Return the beginning with the still images that the table `images` asks for."""
        return cls(images.still, images.still_every_s)

    def steps(self, index: int, _: Positions) -> list[ProtocolStep]:
        """Return the steps of the grid images, of the reference images and of the still images."""
        grid = [ProtocolStep(0, "grid")] if self.grid else []
        reference = [self.reference] if self.has_reference else []
        times_s = [number * self.still_every_s for number in range(1, self.still + 1)]
        still = at_times(ProtocolStep(0, "static", load_drop="slow"), times_s)
        steps = [*grid, *reference, *still]
        return [replace(step, index=number) for number, step in enumerate(steps, index)]

    def follow(self, index: int, place: Positions, _: RigReading | None, execute: Execute) -> RigReading:
        """Execute all steps, and return the reading at the last one."""
        *others, last = self.steps(index, place)
        for step in others:
            execute(step)
        return execute(last)

    def end(self, place: Positions) -> Positions:
        """Return the position of the devices after the reference images, when a preload is still applied."""
        if self.reference.quantity is None:
            return place
        return place.after("load", self.reference.target)
