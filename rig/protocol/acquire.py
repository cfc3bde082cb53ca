"""The protocol of the kind "acquire": images beside a machine that this program does not command."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

from pydantic import Field, model_validator

from dic.runfile.schema import StepKind
from rig.protocol.acquisition_tables import MOST_IMAGES, End, EndOfSignals, Schedule
from rig.protocol.base import BaseProtocol
from rig.protocol.conditions import Conditions
from rig.protocol.course import Beginning, Course, CoursePart, Positions
from rig.protocol.dues import Dues
from rig.protocol.grid import Grid, GridTable
from rig.protocol.images import Images
from rig.protocol.live_table import LiveTable, unknown_gauges
from rig.protocol.pull_stages import PullPlan
from rig.protocol.step import Execute, ProtocolStep, RigReading
from rig.protocol.tables import Sample, Settle

UNKNOWN_SAMPLE = Sample.model_construct(
    name="specimen", thickness_mm=math.nan, width_mm=math.nan, gauge_length_mm=math.nan, direction_deg=None
)
"""A specimen of which the protocol states nothing: there are loads, but no stresses."""

_PLANNED_MAX = 50_000
"""A longer list of planned images is not made; the plan then states no number."""


class AcquireImages(Images):
    """The images of an acquisition. A machine that may already pull allows no still images by default."""

    still: int = Field(
        default=0, ge=0, le=100, description="number of still images of the specimen before the test"
    )


class AcquireProtocol(BaseProtocol):
    """Images at times or events, beside a machine that is closed, until something ends them."""

    kind: Literal["acquire"]
    sample: Sample = UNKNOWN_SAMPLE
    images: AcquireImages = AcquireImages()
    acquire: Schedule
    end: End
    grid: GridTable = Grid()
    grid_images: Literal["before", "after", "never"] = Field(
        default="before", description="when the operator attaches the grid; never if another run calibrates"
    )
    reference: bool = Field(
        default=True, description="reference images before the test; false takes the first image instead"
    )
    settle: Settle = Settle(dwell_s=0.1, timeout_s=30.0, poll_s=0.02)
    live: LiveTable | None = None

    @model_validator(mode="after")
    def _agrees_with_itself(self) -> "AcquireProtocol":
        if self.acquire.times_s is not None and not self._times_s:
            raise ValueError("end.duration_s is before the first of acquire.times_s; make it longer")
        if self.acquire.logarithmic is not None and self.end.duration_s is None and self.end.images is None:
            raise ValueError("end.duration_s or end.images is expected with acquire.logarithmic; add it")
        if mistakes := unknown_gauges(self.live, {*self.acquire.gauges, *self.end.gauges}):
            raise ValueError("; ".join(mistakes))
        if self.live is not None and not self.reference:
            raise ValueError("reference images are expected with the table live; remove reference = false")
        return self

    @property
    def signals(self) -> set[str]:
        """The signals that the protocol needs."""
        return {*self.acquire.signals, *self.end.signals}

    @property
    def _times_s(self) -> list[float] | None:
        duration_s = self.end.duration_s or math.inf
        return self.acquire.times(duration_s, self.end.images or MOST_IMAGES)

    @cached_property
    def course(self) -> Course:
        """The course of the test: grid and reference images if wanted, then the images of the test."""
        beginning = Beginning(
            self.images.still if self.reference else 0,
            self.images.still_every_s,
            grid=self.grid_images == "before",
            has_reference=self.reference,
        )
        parts: list[CoursePart] = [beginning] if beginning.grid or beginning.has_reference else []
        parts.append(self.acquisition)
        if self.grid_images == "after":
            parts.append(GridAfter())
        return Course(tuple(parts), Positions())

    @property
    def acquisition(self) -> "Acquisition":
        """The part of the course with the images of the test."""
        return Acquisition(self.acquire, self.end, not self.reference)

    @property
    def planned_steps(self) -> int | None:
        """The number of all steps, None if events decide it."""
        images = self.acquisition.planned
        others = sum(step.acquisition is None for step in self.steps())
        return None if images is None else others + images

    @property
    def conditions(self) -> Conditions:
        """The requirements of the protocol for the rig: no device moves."""
        return Conditions(devices=frozenset(), signals=frozenset(self.signals))


@dataclass(frozen=True)
class Acquisition:
    """The part of a course whose images are due at times or events.

    `first_is_reference` is True if the first image is the reference. `pull` is the motion of the load frame
    meanwhile, None beside a machine that takes no commands.
    """

    schedule: Schedule
    end_of: End
    first_is_reference: bool = False
    pull: PullPlan | None = None

    @property
    def duration_s(self) -> float:
        """The longest time after the first image, in s."""
        return math.inf if self.end_of.duration_s is None else self.end_of.duration_s

    @property
    def images(self) -> int:
        """The largest number of images of each camera."""
        return self.end_of.images or MOST_IMAGES

    @property
    def interval_s(self) -> float:
        """The time that was asked for between two images, NaN without a fixed one."""
        return math.nan if self.schedule.every_s is None else self.schedule.every_s

    @property
    def planned(self) -> int | None:
        """The number of images of each camera, None if events decide it."""
        times_s = self.schedule.times(self.duration_s, self.images)
        return self.end_of.images if times_s is None else len(times_s)

    def dues(self) -> Dues:
        """Return what tells the times of the images."""
        return self.schedule.dues(self.duration_s, self.images)

    def end_of_signals(self) -> EndOfSignals:
        """Return what looks for the events that end the images."""
        return EndOfSignals(self.end_of)

    def step(self, index: int, number: int, at_s: float = math.nan) -> ProtocolStep:
        """Return the step of an image, `number` from 0, `at_s` after the first one."""
        kind: StepKind = "reference" if number == 0 and self.first_is_reference else "acquired"
        return ProtocolStep(
            index + number, kind, at_s=at_s, begins=number == 0, conditional=number > 0, acquisition=self
        )

    def steps(self, index: int, _: Positions) -> list[ProtocolStep]:
        """Return a step for each image whose time is known, and otherwise for the first one alone."""
        times_s = self.schedule.times(self.duration_s, self.images)
        if times_s is None or len(times_s) > _PLANNED_MAX:
            return [self.step(index, 0)]
        return [self.step(index, number, at_s) for number, at_s in enumerate(times_s)]

    def follow(self, index: int, _: Positions, __: RigReading | None, execute: Execute) -> RigReading:
        """Execute the first step; the engine takes all images with it."""
        return execute(self.step(index, 0, 0.0))

    def end(self, place: Positions) -> Positions:
        """Return the possible positions afterwards."""
        if self.pull is None:
            return place
        return place.after("displacement", self.pull.displacement_mm, early=True)


@dataclass(frozen=True)
class GridAfter:
    """Images of the grid after the test."""

    def steps(self, index: int, _: Positions) -> list[ProtocolStep]:
        """Return the step of the grid images."""
        return [ProtocolStep(index, "grid")]

    def follow(self, index: int, place: Positions, _: RigReading | None, execute: Execute) -> RigReading:
        """Execute the step. The index follows that of the last image, so it may differ from the plan."""
        return execute(self.steps(index, place)[0])

    def end(self, place: Positions) -> Positions:
        """Return the same positions."""
        return place
