"""The protocol of the kind "phases": a list of phases, which is compiled to a course."""

from functools import cached_property, reduce
from operator import or_
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

from pydantic import Discriminator, Field, model_validator

from drivers.settings import Settings
from rig.protocol.base import BaseProtocol
from rig.protocol.conditions import Conditions
from rig.protocol.course import Beginning, Course
from rig.protocol.draft import Draft, Phase
from rig.protocol.live_table import LiveTable, unknown_gauges
from rig.protocol.phases import PHASES
from rig.protocol.plausible import Plausible
from rig.protocol.tables import Limits, PhasesSettle

if TYPE_CHECKING:
    PhaseTable: TypeAlias = Phase
else:
    PhaseTable = Annotated[reduce(or_, PHASES), Discriminator("do")]


class Start(Settings):
    """The table `start`: the largest load that is set to zero before the reference images."""

    tare_max_n: float = Field(ge=0.0, description="highest load that may be set to zero at the reference")


class PhasesProtocol(BaseProtocol):
    """A protocol that lists the phases of a test."""

    kind: Literal["phases"]
    phases: list[PhaseTable] = Field(min_length=1, max_length=1000)
    settle: PhasesSettle
    start: Start | None = None
    limits: Limits | None = None
    plausible: Plausible = Plausible()
    live: LiveTable | None = None

    @model_validator(mode="after")
    def _agrees_with_itself(self) -> "PhasesProtocol":
        mistakes = self._draft.mistakes
        if gauges := self._draft.gauges:
            mistakes = [*mistakes, *unknown_gauges(self.live, gauges)]
        if mistakes:
            raise ValueError("; ".join(mistakes))
        return self

    @cached_property
    def _draft(self) -> Draft:
        tare_max_n = None if self.start is None else self.start.tare_max_n
        area_mm2 = self.sample.thickness_mm * self.sample.width_mm
        return Draft(self.phases, self.settle, self.limits, tare_max_n, Beginning.of(self.images), area_mm2)

    @property
    def course(self) -> Course:
        """The phases of the test."""
        return self._draft.course

    @property
    def conditions(self) -> Conditions:
        """The requirements of the protocol for the rig."""
        return self._draft.conditions
