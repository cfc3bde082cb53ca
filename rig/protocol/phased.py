"""The protocol of the kind "phases": a list of phases, which is compiled to a course."""

from functools import cached_property
from typing import Literal

from pydantic import Field, model_validator

from drivers.settings import Settings
from rig.mounting import Mounting
from rig.protocol.compiler import Compiler
from rig.protocol.conditions import Conditions
from rig.protocol.course import Course
from rig.protocol.grid import Grid, GridTable
from rig.protocol.images import Images
from rig.protocol.kind import KnownKind
from rig.protocol.phases import PhaseTable
from rig.protocol.plausible import Plausible
from rig.protocol.step import Execute, ProtocolStep
from rig.protocol.tables import Limits, PhasesSettle, Sample


class Start(Settings):
    """The table `start`: the largest load that is set to zero before the reference images."""

    tare_max_n: float = Field(ge=0.0, description="highest load that may be set to zero at the reference")


class PhasesProtocol(Settings):
    """A protocol that lists the phases of a test."""

    kind: KnownKind[Literal["phases"]]
    title: str = Field(min_length=1, max_length=200)
    sample: Sample
    phases: list[PhaseTable] = Field(min_length=1, max_length=1000)
    settle: PhasesSettle
    grid: GridTable = Grid()
    images: Images = Images()
    mounting: Mounting = Mounting()
    start: Start | None = None
    limits: Limits | None = None
    plausible: Plausible = Plausible()

    @model_validator(mode="after")
    def _agrees_with_itself(self) -> "PhasesProtocol":
        if mistakes := self._compiler.mistakes:
            raise ValueError("; ".join(mistakes))
        return self

    @cached_property
    def _compiler(self) -> Compiler:
        tare_max_n = None if self.start is None else self.start.tare_max_n
        return Compiler(self.phases, self.settle, self.limits, tare_max_n)

    @property
    def course(self) -> Course:
        """The phases of the test."""
        return self._compiler.course

    def steps(self) -> list[ProtocolStep]:
        """Return the steps of the longest possible test."""
        return self.course.steps()

    def follow(self, execute: Execute) -> None:
        """Call `execute` for each step, in order. The settled readings decide how many steps are executed.

        Raises
        ------
        ProtocolError
            If a phase reaches its target, but the event that should end it never happened.
        """
        self.course.follow(execute)

    @property
    def conditions(self) -> Conditions:
        """The requirements of the protocol for the rig."""
        return self._compiler.conditions
