"""Tables of facts in a report, each of which can be followed to the file, the step and the rule behind it."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

NOT_STATED = "not stated"
"""Text in the report for a fact that is neither measured nor stated by the user."""


@dataclass(frozen=True)
class Fact:
    """A fact in words, and where it comes from."""

    text: str = NOT_STATED
    file: str = ""
    """The file that contains the fact, or the values from which it is computed; "" for a fact that is not
    stated.
    """
    step: str = ""
    """The part of the file: a table of stated facts, an image, or a part of the evaluation."""
    rule: str = NOT_STATED
    """How the fact follows from this part: a key, or the rule of the computation."""

    @property
    def is_known(self) -> bool:
        """True if the fact is stated or measured."""
        return self.text != NOT_STATED

    def as_dict(self) -> dict[str, str | None]:
        """Return the fact for JSON."""
        return {
            "text": self.text if self.is_known else None,
            "file": self.file or None,
            "step": self.step or None,
            "rule": self.rule,
        }


@dataclass(frozen=True)
class FactTable:
    """A table with a row for each fact and a column for each camera."""

    heads: list[str]
    """Names of the cameras; [""] for a table that is not about cameras, or for a series of images."""
    facts: list[tuple[str, list[Fact]]]
    """Name of each fact, and the fact of each camera."""
    doubts: list[str] = field(default_factory=list)
    """One sentence for each source of facts that exists but cannot be used."""

    @property
    def rows(self) -> list[tuple[str, list[str]]]:
        """Name of each fact, and its text for each camera."""
        return [(name, [fact.text for fact in facts]) for name, facts in self.facts]

    def as_list(self) -> list[dict[str, Any]]:
        """Return each fact of each camera for JSON."""
        return [
            {"name": name, "camera": head or None} | fact.as_dict()
            for name, facts in self.facts
            for head, fact in zip(self.heads, facts, strict=True)
        ]


def table_of(heads: Sequence[str], columns: Sequence[dict[str, Fact]]) -> FactTable:
    """Return the table of all facts that at least one camera has, in the order in which they first appear."""
    missing = Fact("–", rule="nothing was measured")
    names = dict.fromkeys(name for column in columns for name in column)
    facts = [(name, [column.get(name, missing) for column in columns]) for name in names]
    return FactTable(list(heads), facts)
