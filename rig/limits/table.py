"""The table of all limits of a run. Each limit has a quantity, a unit, and bounds with their sources."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from rig.errors import LimitViolation


@dataclass(frozen=True)
class Bound:
    """One end of a limit: the value and the setting that gives it."""

    value: float
    source: str


@dataclass(frozen=True)
class Limit:
    """The allowed range of one quantity. A missing lower or upper bound is None."""

    quantity: str
    unit: str
    least: Bound | None = None
    greatest: Bound | None = None

    def narrowed(self, other: "Limit") -> "Limit":
        """Return the narrower range of two limits of the same quantity."""
        least = max(_bounds(self.least, other.least), key=lambda bound: bound.value, default=None)
        greatest = min(_bounds(self.greatest, other.greatest), key=lambda bound: bound.value, default=None)
        return Limit(self.quantity, self.unit, least, greatest)

    def beyond(self, value: float) -> Bound | None:
        """Return the bound that a value violates, or None. NaN violates every bound."""
        if self.least is not None and not value >= self.least.value:
            return self.least
        if self.greatest is not None and not value <= self.greatest.value:
            return self.greatest
        return None

    def __str__(self) -> str:
        unit = f" {self.unit}" if self.unit else ""
        ends = [
            f"{words} {bound.value:.6g}{unit} ({bound.source})"
            for words, bound in (("at least", self.least), ("at most", self.greatest))
            if bound is not None
        ]
        return f"{self.quantity}: {', '.join(ends)}"


class LimitTable:
    """All limits of a run, by quantity. If a quantity has several limits, the narrowest limit applies.

    Limits that have no bound are left out.
    """

    def __init__(self, limits: Iterable[Limit]) -> None:
        self._limits: dict[str, Limit] = {}
        for limit in limits:
            if limit.least is None and limit.greatest is None:
                continue
            known = self._limits.get(limit.quantity)
            self._limits[limit.quantity] = limit if known is None else known.narrowed(limit)

    def __iter__(self) -> Any:
        return iter(self._limits.values())

    def get(self, quantity: str) -> Limit | None:
        """Return the limit of a quantity, or None."""
        return self._limits.get(quantity)

    def greatest(self, quantity: str) -> float | None:
        """Return the value of a quantity's upper bound, or None."""
        limit = self._limits.get(quantity)
        return None if limit is None or limit.greatest is None else limit.greatest.value

    def check(self, quantity: str, value: float, step: str) -> None:
        """Raise `LimitViolation` if a value is beyond the limit of its quantity."""
        limit = self._limits.get(quantity)
        bound = None if limit is None else limit.beyond(value)
        if limit is None or bound is None:
            return
        # A limit in both directions comes from one positive setting, so name this setting.
        both_ways = bound.value < 0.0 and limit.greatest is not None and limit.greatest.source == bound.source
        bound = limit.greatest if both_ways and limit.greatest is not None else bound
        upper = bound is limit.greatest
        unit = f" {limit.unit}" if limit.unit else ""
        raise LimitViolation(
            step,
            f"{_article(quantity)} {'within' if upper else 'of at least'} {bound.value:g}{unit}",
            f"{value:.6g}{unit}",
            "look at the specimen before anything moves again; only if it is sound, "
            f"{'raise' if upper else 'lower'} {bound.source} {'above' if upper else 'below'} {bound.value:g}",
        )

    def rows(self) -> list[dict[str, Any]]:
        """Return the table for JSON, with None for a missing bound."""
        return [
            {
                "quantity": limit.quantity,
                "unit": limit.unit,
                "least": None if limit.least is None else limit.least.value,
                "least_from": None if limit.least is None else limit.least.source,
                "greatest": None if limit.greatest is None else limit.greatest.value,
                "greatest_from": None if limit.greatest is None else limit.greatest.source,
            }
            for limit in self
        ]


def _article(quantity: str) -> str:
    return f"{'an' if quantity[0] in 'aeiou' else 'a'} {quantity}"


def _bounds(*bounds: Bound | None) -> list[Bound]:
    return [bound for bound in bounds if bound is not None]
