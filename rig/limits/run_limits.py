"""The limits of one run, from the protocol and the opened rig."""

from dataclasses import dataclass, replace

from rig.devices import Rig
from rig.facts import UNKNOWN_RIG, RigFacts, confirm
from rig.limit_settings import RigLimits
from rig.limits.in_force import limit_table, table_objections
from rig.limits.stiffness import LoadStringBounds, load_string
from rig.limits.table import LimitTable
from rig.protocol.acquire import AcquireProtocol
from rig.protocol.protocol import Protocol
from rig.protocol.rotation import RotationProtocol
from rig.rigfile import RigFile


@dataclass(frozen=True)
class RunLimits:
    """The limits of a run."""

    table: LimitTable
    # the plausible behaviour of specimen, grips and load frame, or None without a load frame
    string: LoadStringBounds | None
    objections: list[str]  # one sentence for each planned motion beyond a limit


def limits_of(protocol: Protocol, facts: RigFacts = UNKNOWN_RIG, rig: RigLimits | None = None) -> RunLimits:
    """Return the limits of a protocol on a rig, from the rig's facts and its table [limits]."""
    rig = rig or RigLimits()
    string = _string(protocol, rig)
    table = limit_table(protocol, facts, rig, string)
    return RunLimits(table, string, table_objections(protocol, table))


def limits_on(protocol: Protocol, rig: Rig) -> RunLimits:
    """Return the limits of a protocol on an opened rig."""
    return limits_of(protocol, confirm(UNKNOWN_RIG, rig), rig.limits)


def slowed(rig_file: RigFile, protocol: Protocol) -> RigFile:
    """Return the rig file with the largest speed that the protocol needs as the load frame's speed limit.

    The driver writes this speed limit into the machine. If the load cell shows less than the true load, the
    controller of the machine pulls further than commanded. The speed limit bounds this motion until the
    engine takes its next reading and detects the error.
    """
    entry = rig_file.load_frame
    known = None if entry is None else entry.setting("speed_max_mm_s")
    string = _string(protocol, rig_file.limits)
    if entry is None or not isinstance(known, float) or string is None:
        return rig_file
    speeds_mm_s = [demand.value for demand in protocol.conditions.demands if demand.fact == "speed_max_mm_s"]
    needed_mm_s = max([string.speed_max_mm_s or 0.0, *speeds_mm_s])
    bounds = [known, needed_mm_s or known, rig_file.limits.speed_max_mm_s or known]
    settings = entry.settings.model_copy(update={"speed_max_mm_s": min(bounds)})
    return replace(rig_file, load_frame=replace(entry, settings=settings))


def _string(protocol: Protocol, rig: RigLimits) -> LoadStringBounds | None:
    if isinstance(protocol, RotationProtocol | AcquireProtocol) or protocol.conditions.pull is None:
        return None
    return load_string(protocol, rig)
