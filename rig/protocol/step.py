"""One step of a protocol, and a reading of the devices."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Literal, Protocol, TypeAlias

from dic.runfile.schema import StepKind
from drivers.interfaces import OperatorQuestion
from rig.samples import SignalReading

Quantity: TypeAlias = Literal["load", "displacement", "rotation"]
"""The quantity that a device changes or holds: the load, the displacement of the grips, or the angle."""

LoadDrop: TypeAlias = Literal["break", "slow", "commanded"]
"""Meaning of a falling load during a step: the specimen breaks, relaxes slowly, or is unloaded by a
command."""

Kind: TypeAlias = StepKind | Literal["ask"]
"""The kind of a step. A question to the operator has no images, so run files have no step of this kind."""

UNITS: dict[Kind, str] = {
    "grid": "",
    "reference": "N",
    "static": "",
    "load": "N",
    "displacement": "mm",
    "rotation": "deg",
    "creep": "N",
    "relaxation": "mm",
    "rest": "",
    "acquired": "",
    "ask": "",
}
"""The unit of a step's target. A reference step has a target only under a preload."""

_QUANTITIES: dict[Kind, Quantity] = {
    "load": "load",
    "displacement": "displacement",
    "rotation": "rotation",
    "reference": "load",
    "creep": "load",
    "relaxation": "displacement",
}


@dataclass(frozen=True)
class RigReading:
    """Load, displacement and angle at the time `time_s` of the rig's clock. A missing device gives NaN.

    If the event that ends the phase happens during a step, `ends_phase` is True in the step's last reading.
    `signals` has the samples of all measured channels since the reading before, by the names of the signals.
    """

    time_s: float
    load_n: float = math.nan
    displacement_mm: float = math.nan
    angle_deg: float = math.nan
    moving: bool = False
    ends_phase: bool = False
    signals: Mapping[str, SignalReading] = field(default_factory=dict, compare=False, repr=False)

    def by_unit(self) -> dict[str, float]:
        """Return load, displacement and angle under the keys "N", "mm" and "deg". Leave out NaN values."""
        values = {"N": self.load_n, "mm": self.displacement_mm, "deg": self.angle_deg}
        return {unit: value for unit, value in values.items() if not math.isnan(value)}

    def mirrored(self) -> "RigReading":
        """Return the reading with the opposite signs of load and displacement: compression as tension."""
        return replace(self, load_n=-self.load_n, displacement_mm=-self.displacement_mm)

    def of(self, quantity: Quantity) -> float:
        """Return the value of a quantity: the load, the displacement or the angle."""
        values = {"load": self.load_n, "displacement": self.displacement_mm, "rotation": self.angle_deg}
        return values[quantity]


class PhaseEvent(Protocol):
    """What ends a phase at once: it is called with every reading, and returns True when it has happened."""

    def __call__(self, reading: RigReading, /) -> bool:
        """Return True if the phase ends at this reading."""

    def renew(self) -> None:
        """Forget the readings so far, because the machine was held in a pause and the load has changed."""


@dataclass(frozen=True)
class ProtocolStep:
    """One step of a protocol: a target, and the images that belong to it.

    A device moves to the target. The cameras take the images when it has settled, or during the motion or
    hold. The steps "grid", "reference" without a preload, "static", "rest" and "ask" have no target.

    Attributes
    ----------
    index : int
        Number of the step in the plan, from 0.
    kind : str
        Images of the undeformed state: "grid", "reference", or "static" for still images after the
        reference. Motions: "load", "displacement" or "rotation".
        Holds: "creep" at a constant load, "relaxation" at a constant displacement, "rest" without a device.
        "ask" for a question to the operator, during which nothing moves.
    target, tolerance : float
        Target and settle tolerance, in N, mm or degrees depending on `kind`. NaN for a step without a target.
    rate : float
        Load rate in N/s or speed in mm/s, depending on `kind`. NaN for a step without a target. Also NaN for
        a rotation, because the stage's driver sets its speed.
    conditional : bool
        True if the behaviour of the specimen decides whether the step is needed.
    at_s : float
        Time of the images, in s after the motion or the hold began. NaN if the images follow settling.
    begins : bool
        True if the step begins a motion or hold. False if it continues the one of the step before.
    images : bool
        False for a motion without images, such as a cycle between two cycles with images.
    travel : float
        Estimated distance from the start of the step to its target, in the target's unit. NaN without a
        motion.
    motion_s : float
        Planned time of the motion in s, which is allowed in addition to `settle.timeout_s`.
    load_drop : str
        The meaning of a fall of the load during the step.
    passed : bool
        True if the target has been passed already, so that the step is left out and nothing moves.
    event : PhaseEvent or None
        The event that ends the phase at once.
    next_s : float
        Time of the next images of the same hold, in s after its beginning. NaN if none follow.
    question : OperatorQuestion or None
        What the operator is asked in a step of the kind "ask".
    acquisition : Acquisition or None
        For the first image of an acquisition, the part of the course with all its images.
    """

    index: int
    kind: Kind
    target: float = math.nan
    tolerance: float = math.nan
    rate: float = math.nan
    conditional: bool = False
    at_s: float = math.nan
    begins: bool = True
    images: bool = True
    travel: float = math.nan
    motion_s: float = 0.0
    load_drop: LoadDrop = "break"
    passed: bool = False
    event: PhaseEvent | None = field(default=None, compare=False, repr=False)
    next_s: float = math.nan
    question: OperatorQuestion | None = None
    acquisition: object | None = field(default=None, compare=False, repr=False)

    @property
    def quantity(self) -> Quantity | None:
        """The quantity that the step changes or holds, or None for a step without a target."""
        return None if math.isnan(self.target) else _QUANTITIES.get(self.kind)

    @property
    def unit(self) -> str:
        """The unit of the target. A step without a target has an empty unit."""
        return "" if math.isnan(self.target) else UNITS[self.kind]

    @property
    def timed(self) -> bool:
        """True if the step's images are taken at a fixed time, and not after settling."""
        return not math.isnan(self.at_s)

    @property
    def stands(self) -> bool:
        """True if nothing may move while the step's images are taken. False during a motion."""
        return self.holds or not self.timed

    @property
    def holds(self) -> bool:
        """True if the step is a hold, during which nothing moves except to keep a load constant."""
        return self.kind in ("static", "creep", "relaxation", "rest", "ask")

    @property
    def pulls(self) -> bool:
        """True if the step moves the load frame to a load or to a displacement."""
        return self.quantity in ("load", "displacement") and not self.holds

    def mirrored(self) -> "ProtocolStep":
        """Return a motion in compression as one in tension, for checks that know only tension."""
        return replace(self, target=-self.target)

    def value(self, reading: RigReading) -> float:
        """Return the quantity of the step's target from a reading: load, displacement or angle.

        For a step without a target, return NaN.
        """
        return math.nan if self.quantity is None else reading.of(self.quantity)

    def is_reached(self, reading: RigReading) -> bool:
        """Return True if the reading is within the tolerance of the target."""
        return self.quantity is None or abs(self.value(reading) - self.target) <= self.tolerance

    def __str__(self) -> str:
        aim = "" if math.isnan(self.target) else f" {self.target:.6g} {self.unit}"
        after = f" after {self.at_s:g} s" if self.timed else ""
        return f"step {self.index} ({self.kind}{aim}{after})"


def at_times(first: ProtocolStep, times_s: list[float]) -> list[ProtocolStep]:
    """Return the steps of one motion or hold, whose images are due at times in s after it has begun.

    `first` is the first of them. A time of NaN means that the images follow settling.
    """
    return [
        replace(
            first,
            index=first.index + number,
            at_s=at_s,
            begins=number == 0,
            # The later images of a motion wait in a pause, and none of them is left out.
            next_s=next_s if first.holds else math.nan,
        )
        for number, (at_s, next_s) in enumerate(pairwise([*times_s, math.nan]))
    ]


Execute: TypeAlias = Callable[[ProtocolStep], RigReading]
