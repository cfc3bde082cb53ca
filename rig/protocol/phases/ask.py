"""The phase `ask`: the operator does something at the machine, and confirms it with a word."""

from dataclasses import dataclass
from typing import Literal

from pydantic import Field

from drivers.interfaces import OperatorQuestion
from rig.protocol.course import Positions
from rig.protocol.draft import Draft, Phase
from rig.protocol.step import Execute, ProtocolStep, RigReading

WORD = r"^[^\W_]+(-[^\W_]+)*$"
"""A word of letters and digits, which may contain hyphens; it can be typed without a mistake."""


class Ask(Phase):
    """A request to the operator, such as to take the extensometer off. Nothing moves until the answer."""

    do: Literal["ask"]
    text: str = Field(min_length=1, max_length=200, description="the request, in one line")
    word: str = Field(
        default="done", pattern=WORD, max_length=30, description="the word that confirms the request"
    )

    def compile(self, draft: Draft) -> None:
        """Add the question."""
        draft.add(Asking(OperatorQuestion(self.text, self.word)))


@dataclass(frozen=True)
class Asking:
    """The part of a course that asks the operator. The machine holds where it stands."""

    question: OperatorQuestion

    def steps(self, index: int, _: Positions) -> list[ProtocolStep]:
        """Return one step without images."""
        return [ProtocolStep(index, "ask", images=False, load_drop="slow", question=self.question)]

    def follow(self, index: int, place: Positions, _: RigReading | None, execute: Execute) -> RigReading:
        """Ask, and return the reading after the answer."""
        return execute(self.steps(index, place)[0])

    def end(self, place: Positions) -> Positions:
        """Return the positions before the question, because nothing was commanded."""
        return place
