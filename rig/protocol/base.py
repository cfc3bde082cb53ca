"""What all kinds of protocols share."""

from abc import ABC, abstractmethod
from typing import Any

from pydantic import Field, field_validator

from drivers.settings import Settings
from rig.mounting import Mounting
from rig.protocol.conditions import Conditions
from rig.protocol.course import Course
from rig.protocol.grid import Grid, GridTable
from rig.protocol.images import Images
from rig.protocol.step import Execute, ProtocolStep
from rig.protocol.tables import Sample

KINDS = ("tension", "rotation", "phases", "acquire")


class BaseProtocol(Settings, ABC):
    """A protocol, which is compiled to a course of steps and to its requirements for the rig."""

    kind: str
    title: str = Field(min_length=1, max_length=200)
    sample: Sample
    grid: GridTable = Grid()
    images: Images = Images()
    mounting: Mounting = Mounting()

    @field_validator("kind", mode="before")
    @classmethod
    def _known_kind(cls, kind: Any) -> Any:
        # Check the kind here, so that the error message names all valid kinds and not only one.
        if kind not in KINDS:
            *others, last = map(repr, KINDS)
            raise ValueError(f"{', '.join(others)} or {last} is expected")
        return kind

    @property
    @abstractmethod
    def course(self) -> Course:
        """The course of the test."""

    @property
    @abstractmethod
    def conditions(self) -> Conditions:
        """The requirements of the protocol for the rig."""

    def steps(self) -> list[ProtocolStep]:
        """Return the steps of the longest possible test."""
        return self.course.steps()

    @property
    def takes_acquisitions(self) -> bool:
        """True if images are taken at times or events, and not only after commanded steps."""
        return any(step.acquisition is not None for step in self.steps())

    def follow(self, execute: Execute) -> None:
        """Call `execute` for each step, in order. The settled readings decide how many steps are executed.

        Raise `ProtocolError` if an increment or a phase should have ended the test or the phase, but its
        event never happened.
        """
        self.course.follow(execute)
