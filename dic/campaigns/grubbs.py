"""Grubbs' test for one outlier among values of a normal distribution."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

LEAST_VALUES = 3
SIGNIFICANCE = 0.05
ROUNDING = 1e-12
"""Values whose relative difference is smaller than this count as equal, because of rounding errors."""
RULE = "Grubbs, two-sided, 5 % (F. E. Grubbs, Technometrics 11, 1969)"


@dataclass(frozen=True)
class GrubbsTest:
    """The value that is farthest from the mean, and whether it is an outlier."""

    place: int | None
    """Index of the value that is farthest from the mean; None if the test was not done."""
    statistic: float | None
    """Distance of this value from the mean, in standard deviations of the values."""
    critical: float | None
    """The statistic above which the value is an outlier."""
    reason: str = ""
    """Why the test was not done; empty if it was done."""

    @property
    def is_outlier(self) -> bool:
        """True if the value that is farthest from the mean is an outlier."""
        return self.statistic is not None and self.critical is not None and self.statistic > self.critical

    def as_dict(self, names: Sequence[str]) -> dict[str, Any]:
        """Return the test for JSON; `names` has the specimen of each value."""
        return {
            "rule": RULE,
            "farthest": None if self.place is None else names[self.place],
            "statistic": self.statistic,
            "critical": self.critical,
            "is_outlier": self.is_outlier,
            "reason": self.reason or None,
        }


def grubbs_test(values: Sequence[float]) -> GrubbsTest:
    """Test whether the value that is farthest from the mean is an outlier, at a significance of 5 %.

    The statistic is the largest distance from the mean, divided by the standard deviation. The critical value
    follows from Student's distribution (F. E. Grubbs, Technometrics 11, 1969, 1-21; NIST/SEMATECH e-Handbook
    of Statistical Methods, 1.3.5.17.1). The test finds one outlier at most. Two outliers on the same side can
    hide each other.
    """
    from scipy.special import stdtrit

    count = len(values)
    if count < LEAST_VALUES:
        return GrubbsTest(None, None, None, f"too few values ({count} of at least {LEAST_VALUES})")
    numbers = np.asarray(values, np.float64)
    std = float(numbers.std(ddof=1))
    if np.ptp(numbers) <= ROUNDING * np.abs(numbers).max():
        return GrubbsTest(None, None, None, "all values are equal")
    away = np.abs(numbers - numbers.mean()) / std
    place = int(np.argmax(away))
    t = float(stdtrit(count - 2, 1.0 - SIGNIFICANCE / (2 * count)))
    critical = (count - 1) / np.sqrt(count) * np.sqrt(t**2 / (count - 2 + t**2))
    return GrubbsTest(place, float(away[place]), float(critical))
