"""Channels of a run beside the gauges, such as the strain of a clip-on extensometer or a temperature."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dic.errors import GaugeError
from dic.records.units import STRAIN
from dic.runfile.steps import RunStep
from dic.typing import Float

PREFIX = "channels."
MEASURED = "measured"
"""The kind of strain of a channel, beside "raw", "calibrated" and "corrected"."""


@dataclass(frozen=True)
class GaugeChannel:
    """A channel of a run.

    Attributes
    ----------
    name : str
        Such as "channels.oven".
    unit : str
    value_column, std_column, lag_column : str
        Names of the values in `GaugeImage.known`.
    """

    name: str
    unit: str
    value_column: str
    std_column: str
    lag_column: str

    def values(self, known: Sequence[Mapping[str, Any]]) -> Float:
        """Return the value at each image, in the unit of the channel; NaN where it is not known."""
        return _column(known, self.value_column)

    def strain(self, known: Sequence[Mapping[str, Any]]) -> Float:
        """Return the value at each image as a strain. Raise `GaugeError` for a unit of another quantity."""
        return self._factor() * self.values(known)

    def strain_std(self, known: Sequence[Mapping[str, Any]]) -> Float:
        """Return the standard deviation of the strain at each image; NaN where it is not known."""
        return self._factor() * _column(known, self.std_column)

    @property
    def is_strain(self) -> bool:
        """True if the unit is one of strain."""
        return self._unit in STRAIN

    def lag(self, known: Sequence[Mapping[str, Any]]) -> Float:
        """Return the change of the strain by the errors of time that all images share; 0 if unknown."""
        return np.nan_to_num(self._factor() * _column(known, self.lag_column))

    @property
    def _unit(self) -> str:
        return self.unit.replace("\u03bc", "µ")

    def _factor(self) -> float:
        if not self.is_strain:
            expected, remedy = f"a channel in one of {', '.join(STRAIN)}", "name a gauge, or another channel"
            raise GaugeError(self.name, "take its strain", expected, f"one in {self.unit}", remedy)
        return STRAIN[self._unit]


def gauge_channels(steps: Sequence[RunStep]) -> dict[str, GaugeChannel]:
    """Return the channels of a run by their names; all steps have the same ones."""
    found = {}
    for each in steps[0].channels if steps else ():
        columns = (each.column(), each.column("std"), each.column("lag"))
        found[f"{PREFIX}{each.name}"] = GaugeChannel(f"{PREFIX}{each.name}", each.unit, *columns)
    return found


def _column(known: Sequence[Mapping[str, Any]], name: str) -> Float:
    return np.array([float(each.get(name, np.nan)) for each in known])
