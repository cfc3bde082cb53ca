"""One step of a protocol, and a reading of the devices."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

from dic.runfile.schema import StepKind

UNITS: dict[StepKind, str] = {
    "grid": "",
    "reference": "",
    "load": "N",
    "displacement": "mm",
    "rotation": "deg",
}


@dataclass(frozen=True)
class Reading:
    """Readings of all devices at `time_s` of the rig's clock; NaN for a missing device."""

    time_s: float
    load_n: float = math.nan
    displacement_mm: float = math.nan
    angle_deg: float = math.nan
    moving: bool = False

    def by_unit(self) -> dict[str, float]:
        """Return load, displacement and angle by "N", "mm" and "deg", without missing devices."""
        values = {"N": self.load_n, "mm": self.displacement_mm, "deg": self.angle_deg}
        return {unit: value for unit, value in values.items() if not math.isnan(value)}


@dataclass(frozen=True)
class ProtocolStep:
    """One step: a device moves to a target (or nothing moves), the value settles, and images are taken.

    Attributes
    ----------
    index : int
        Number in the plan, from 0.
    kind : str
        "grid", "reference", "load", "displacement" or "rotation".
    target, tolerance : float
        N, mm or degrees by `kind`; NaN where nothing moves.
    rate : float
        N/s or mm/s by `kind`; NaN where nothing moves and for the stage, whose driver knows its speed.
    conditional : bool
        Whether the specimen decides if the step is needed.
    """

    index: int
    kind: StepKind
    target: float = math.nan
    tolerance: float = math.nan
    rate: float = math.nan
    conditional: bool = False

    def value(self, reading: Reading) -> float:
        """Return the value of `reading` that this step moves; NaN where nothing moves."""
        values = {
            "load": reading.load_n,
            "displacement": reading.displacement_mm,
            "rotation": reading.angle_deg,
        }
        return values.get(self.kind, math.nan)

    def __str__(self) -> str:
        aim = "" if math.isnan(self.target) else f" {self.target:.6g} {UNITS[self.kind]}"
        return f"step {self.index} ({self.kind}{aim})"


Execute: TypeAlias = Callable[[ProtocolStep], Reading]
