"""Mean and scatter of one property over several specimens."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dic.campaigns.grubbs import GrubbsTest, grubbs_test
from dic.properties.value import PropertyValue


@dataclass(frozen=True)
class Scatter:
    """One property of several specimens."""

    unit: str
    names: tuple[str, ...]
    """The specimens that have the property."""
    values: tuple[float, ...]
    """The property of each of these specimens."""
    mean: float | None
    """Mean of the values; None if no specimen has the property."""
    std_between: float | None
    """Standard deviation between the specimens, with n - 1 in the divisor; None for fewer than two values."""
    standard_error: float | None
    """Standard deviation of the mean, computed from the scatter: `std_between` divided by the square root of
    n. The standard error does not contain errors that are common to all specimens, such as the error of the
    load cell.
    """
    stated_std: float | None
    """Root mean square of the stated standard deviations of the values; None if a value has none. If
    `std_between` is much larger than `stated_std`, the specimens differ. Otherwise the measurement alone can
    explain the scatter.
    """
    outlier: GrubbsTest

    @property
    def count(self) -> int:
        """Number of specimens that have the property."""
        return len(self.values)

    @property
    def outlying(self) -> str | None:
        """Name of the specimen that is an outlier; None if there is none."""
        test = self.outlier
        return self.names[test.place] if test.place is not None and test.is_outlier else None

    @property
    def std_of_mean(self) -> float | None:
        """Standard deviation of the mean, from the scatter or from `stated_std`, whichever gives more."""
        stated = None if self.stated_std is None else self.stated_std / np.sqrt(self.count)
        known = [float(std) for std in (self.standard_error, stated) if std is not None]
        return max(known, default=None)

    def as_dict(self) -> dict[str, Any]:
        """Return the values and their statistics as a dict for JSON."""
        return {
            "unit": self.unit,
            "count": self.count,
            "mean": self.mean,
            "std_between": self.std_between,
            "standard_error": self.standard_error,
            "stated_std": self.stated_std,
            "outlier": self.outlier.as_dict(self.names),
        }


def scatter_of(found: Mapping[str, PropertyValue]) -> Scatter:
    """Return the mean and the scatter of a property.

    `found`: the property of each specimen, keyed by the specimen's name. Specimens whose value is None are
    left out.
    """
    present = {name: value.value for name, value in found.items() if value.value is not None}
    stds = [value.std for value in found.values() if value.value is not None]
    values = tuple(present.values())
    std = float(np.std(values, ddof=1)) if len(values) > 1 else None
    return Scatter(
        unit=next(iter(found.values())).unit,
        names=tuple(present),
        values=values,
        mean=float(np.mean(values)) if values else None,
        std_between=std,
        standard_error=None if std is None else std / float(np.sqrt(len(values))),
        stated_std=_root_mean_square(stds),
        outlier=grubbs_test(values),
    )


def _root_mean_square(stds: Sequence[float | None]) -> float | None:
    known = [std for std in stds if std is not None]
    if not known or len(known) < len(stds):
        return None
    return float(np.sqrt(np.mean(np.square(known))))
