"""What a protocol requires of the rig: devices, conditions for zeroing, and values that must be allowed."""

from dataclasses import dataclass
from typing import Literal, TypeAlias

from rig.protocol.step import RigReading
from rig.protocol.tables import Limits

TARE_PER_INCREMENT = 0.1
"""When the load is set to zero, the specimen may carry at most this fraction of a load increment."""

DeviceName: TypeAlias = Literal["load_frame", "stage"]


@dataclass(frozen=True)
class Zeroing:
    """Conditions for setting load and displacement to zero before the reference images."""

    tare_max_n: float  # highest load in N that may be set to zero
    key: str  # the key of `tare_max_n` in the protocol file
    # largest accepted readings after load and displacement were set to zero
    load_tolerance_n: float
    displacement_tolerance_mm: float

    def is_zero(self, reading: RigReading) -> bool:
        """Return True if load and displacement are within their tolerances of zero."""
        return (
            abs(reading.load_n) <= self.load_tolerance_n
            and abs(reading.displacement_mm) <= self.displacement_tolerance_mm
        )


@dataclass(frozen=True)
class Demand:
    """A value of the protocol that the rig's limits must allow."""

    key: str  # the key in the protocol file
    value: float
    fact: str  # name of the rig's limit for this value, an attribute of `rig.facts.RigFacts`
    unit: str
    is_lowest: bool = False  # True if the rig's limit is a lower limit, False if it is an upper limit

    @classmethod
    def of_limits(cls, limits: Limits | None) -> "tuple[Demand, ...]":
        """Return the demands of the protocol's limits of load and displacement."""
        if limits is None:
            return ()
        both = [("load", "n", "N"), ("displacement", "mm", "mm")]
        ends = [
            (f"{quantity}_{end}_{unit}", shown) for end in ("max", "min") for quantity, unit, shown in both
        ]
        return tuple(
            cls(f"limits.{name}", value, name, unit, is_lowest="_min_" in name)
            for name, unit in ends
            if (value := getattr(limits, name)) is not None
        )


@dataclass(frozen=True)
class StageTurn:
    """A turn of the stage within one step, which must end within `settle.timeout_s`."""

    key: str
    travel_deg: float


@dataclass(frozen=True)
class Pull:
    """The loads of a test as its protocol gives them, for the agreement of load and displacement."""

    increment_n: float  # an increment of load. On the first loading the specimen is elastic up to this load.
    rate_n_s: float | None  # highest rate of loading, or None if no load is commanded
    assured_n: float  # load that the specimen carries in every test that ends as planned
    elastic_n: float = 0.0  # load up to which the specimen is not expected to yield
    # 1 if the test begins in tension, -1 if it begins in compression. The loads above have no sign.
    sense: float = 1.0


@dataclass(frozen=True)
class Conditions:
    """The requirements of a protocol for the rig."""

    devices: frozenset[DeviceName]  # the devices that the protocol moves
    limits: Limits | None = None  # the limits of load and displacement, or None without a load frame
    # load in N that the specimen must have carried before a drop in load counts as a break
    carried_n: float = 0.0
    zeroing: Zeroing | None = None
    pull: Pull | None = None  # the loads of the test, or None without a load frame
    # tolerance of the stage at 0 degrees before the images of the grid, or None if the stage does not move
    zero_tolerance_deg: float | None = None
    demands: tuple[Demand, ...] = ()
    turns: tuple[StageTurn, ...] = ()
    signals: frozenset[str] = frozenset()  # the measured channels that the protocol needs
    strain_rates: tuple[str, ...] = ()  # the phases in which a strain rate changes the speed of a motion
