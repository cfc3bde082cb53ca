"""A material property with its uncertainty, its rule, its window, and its flags."""

from dataclasses import dataclass, field
from statistics import NormalDist
from typing import Any

import numpy as np

NORMAL_95 = 1.959964
"""Half width of the 95 % interval of a normal distribution, in standard deviations."""


@dataclass(frozen=True)
class PropertyValue:
    """A property of the material.

    Attributes
    ----------
    value : float or None
        None if the record does not give the property; then `flags` has the reason.
    std : float or None
        Standard deviation of the value.
    unit : str
    rule : str
        How the value was found.
    window : dict
        The part of the record from which the value was found.
    flags : tuple of str
        Objections to the value. Each begins with a word that programs can read, such as "toe:".
    """

    value: float | None
    std: float | None
    unit: str
    rule: str
    window: dict[str, Any] = field(default_factory=dict)
    flags: tuple[str, ...] = ()

    @property
    def low(self) -> float | None:
        """Lower end of the 95 % interval."""
        return None if self.value is None or self.std is None else self.value - NORMAL_95 * self.std

    @property
    def high(self) -> float | None:
        """Upper end of the 95 % interval."""
        return None if self.value is None or self.std is None else self.value + NORMAL_95 * self.std

    def as_dict(self) -> dict[str, Any]:
        """Return the values for JSON: value, std, low, high, unit, rule, window, flags."""
        return {
            "value": self.value,
            "std": self.std,
            "low": self.low,
            "high": self.high,
            "unit": self.unit,
            "rule": self.rule,
            "window": self.window,
            "flags": list(self.flags),
        }


def missing(unit: str, rule: str, reason: str) -> PropertyValue:
    """Return a property without a value, with the reason why the record does not give one."""
    return PropertyValue(None, None, unit, rule, flags=(f"missing: {reason}",))


def excess_of_extreme(std: float, count: int) -> float:
    """Return the mean excess of the largest of `count` equal values that have noise.

    The formula is from G. Blom (Statistical Estimates and Transformed Beta-Variables, 1958) for the expected
    largest of independent normal values.
    """
    share = (count - 0.375) / (count + 0.25)
    return std * max(float(NormalDist().inv_cdf(share)), 0.0)


def root_sum(*parts: float) -> float:
    """Return the standard deviation of a sum of independent parts."""
    return float(np.sqrt(np.sum(np.square(parts))))
