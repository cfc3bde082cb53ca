"""The plan of a run, known before anything moves: steps, duration, bytes and the worst load."""

import math
import shutil
from dataclasses import dataclass
from pathlib import Path

from rig.errors import ProtocolError
from rig.facts import UNKNOWN_RIG, RigFacts, objections
from rig.protocol.protocol import Protocol, TensionProtocol
from rig.protocol.step import ProtocolStep

SECONDS_PER_IMAGE = 0.1
"""Assumed for exposure, transfer and recording; the rest of the duration follows from the protocol."""

_SPACE_MARGIN = 1.1


@dataclass(frozen=True)
class PlannedStep:
    """A step with its estimated duration; None if the speed of the motion is unknown."""

    step: ProtocolStep
    duration_s: float | None


@dataclass(frozen=True)
class Plan:
    """The worst case of a run.

    Attributes
    ----------
    steps : list of PlannedStep
        The specimen decides which of the conditional steps are executed.
    images : int or None
        Number of images of all steps and cameras; None without a rig file.
    size_bytes : int or None
        Size of all images; None where the size of an image is unknown.
    worst_load_n, worst_displacement_mm : float
        The limits of the protocol, NaN for a rotation; the engine ends a run that exceeds them.
    objections : list of str
        Reasons why this rig cannot execute the protocol; `rig run` refuses to start if there is any.
    """

    title: str
    kind: str
    steps: list[PlannedStep]
    images: int | None
    size_bytes: int | None
    worst_load_n: float
    worst_displacement_mm: float
    objections: list[str]

    @property
    def duration_s(self) -> float | None:
        """Estimated for all steps, without the operator's time; None if unknown for any step."""
        durations = [planned.duration_s for planned in self.steps]
        return None if None in durations else math.fsum(d for d in durations if d is not None)


def make_plan(protocol: Protocol, facts: RigFacts = UNKNOWN_RIG) -> Plan:
    """Plan the worst case of `protocol` on the rig of `facts`."""
    steps = protocol.steps()
    per_step = protocol.images.per_step
    still_s = protocol.settle.dwell_s + per_step * (facts.cameras or 0) * SECONDS_PER_IMAGE
    planned = []
    before: dict[str, float] = {}
    for step in steps:
        motion_s = _motion_s(step, before.get(step.kind, 0.0), facts)
        before[step.kind] = step.target
        planned.append(PlannedStep(step, None if motion_s is None else motion_s + still_s))
    limits = protocol.limits if isinstance(protocol, TensionProtocol) else None
    return Plan(
        title=protocol.title,
        kind=protocol.kind,
        steps=planned,
        images=None if facts.cameras is None else len(steps) * per_step * facts.cameras,
        size_bytes=None if facts.image_bytes is None else len(steps) * per_step * facts.image_bytes,
        worst_load_n=math.nan if limits is None else limits.load_max_n,
        worst_displacement_mm=math.nan if limits is None else limits.displacement_max_mm,
        objections=objections(protocol, facts),
    )


def require_feasible(plan: Plan, folder: Path) -> None:
    """Refuse a run that the rig does not allow or whose images do not fit on the disk.

    Raises
    ------
    ProtocolError
        If there are objections, no folder for the run file, or too little free space.
    """
    if plan.objections:
        raise ProtocolError(
            plan.title,
            "a protocol within the limits of the rig",
            f"{len(plan.objections)} objections",
            "; ".join(plan.objections),
        )
    if not folder.is_dir():
        raise ProtocolError(
            str(folder), "a folder for the run file", "none", "create it, or name another folder with -o"
        )
    needed, free = int((plan.size_bytes or 0) * _SPACE_MARGIN), shutil.disk_usage(folder).free
    if needed > free:
        raise ProtocolError(
            str(folder),
            f"{format_bytes(needed)} of free space for the run",
            format_bytes(free),
            "free disk space, or name a folder on another disk with -o",
        )


def format_bytes(size: int) -> str:
    """Return a size as text, in MB or GB."""
    return f"{size / 1e6:.1f} MB" if size < 1e9 else f"{size / 1e9:.1f} GB"


def _motion_s(step: ProtocolStep, before: float, facts: RigFacts) -> float | None:
    if math.isnan(step.target):
        return 0.0
    rate = facts.speed_deg_s if step.kind == "rotation" else step.rate
    return None if rate is None else (step.target - before) / rate
