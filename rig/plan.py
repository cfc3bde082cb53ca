"""Plan a run before any device moves: steps, duration, size of the images and highest load."""

import math
import shutil
from dataclasses import dataclass, field
from pathlib import Path

from rig.errors import ProtocolError
from rig.facts import UNKNOWN_RIG, RigFacts, objections
from rig.limit_settings import RigLimits
from rig.limits.run_limits import RunLimits, limits_of
from rig.mounting import Mounting
from rig.protocol.acquire import AcquireProtocol, Acquisition
from rig.protocol.durations import motion_times_s
from rig.protocol.protocol import Protocol
from rig.protocol.step import ProtocolStep
from rig.recorder.space import largest_file_bytes

SECONDS_PER_IMAGE = 0.1
"""Assumed time in s for exposing, transferring and recording one image."""

_SPACE_MARGIN = 1.1


@dataclass(frozen=True)
class PlannedStep:
    """A step and its estimated duration in s. The duration is None if the speed of the motion is unknown."""

    step: ProtocolStep
    duration_s: float | None


@dataclass(frozen=True)
class AcquisitionPlan:
    """What is known beforehand about the images at times or events.

    Attributes
    ----------
    text : str
        When images are due, and what ends them.
    images : int or None
        Number of images of each camera, None if events decide it.
    interval_s : float or None
        Time between two images, None without a fixed one.
    keep_s : float or None
        Time in s for which images stay in the file, None if all of them stay.
    image_bytes : int or None
        Size of one image of all cameras together, None if it is unknown.
    """

    text: str
    images: int | None
    interval_s: float | None
    keep_s: float | None
    image_bytes: int | None

    @property
    def images_per_hour(self) -> float | None:
        """Number of images of each camera in an hour, None without a fixed rate."""
        return None if self.interval_s is None else 3600.0 / self.interval_s

    @property
    def images_on_file(self) -> int | None:
        """Number of images of each camera that stay in the file, None if it is unknown."""
        if self.keep_s is None or self.interval_s is None:
            return self.images
        kept = math.ceil(self.keep_s / self.interval_s) + 1
        return kept if self.images is None else min(kept, self.images)


@dataclass(frozen=True)
class Plan:
    """The plan of the longest possible run of a protocol.

    Attributes
    ----------
    steps : list of PlannedStep
        All possible steps. Steps with `conditional` are executed only if the behaviour of the specimen
        requires them.
    images : int or None
        Number of images from all steps and all cameras, or None without a rig file, or if events decide it.
    size_bytes : int or None
        Size of all images in the file in bytes, or None if their number or the size of an image is unknown.
    worst_load_n, worst_displacement_mm : float
        The limits of load and displacement beyond which the engine ends a tension test. NaN for a rotation.
    least_load_n, least_displacement_mm : float or None
        The same limits in compression, if the protocol declares them.
    limits : RunLimits
        The merged limits of the run, and the plausible behaviour of specimen, grips and load frame.
    objections : list of str
        Reasons why the rig cannot execute the protocol. `rig run` starts only if this list is empty.
    cautions : list of str
        Warnings about dangers that the rig file accepts. Every start of a run prints them.
    mounting : Mounting
        The mounting of grid and specimen, as the protocol and the rig file declare it.
    acquisition : AcquisitionPlan or None
        The images at times or events, None for another protocol.
    """

    title: str
    kind: str
    steps: list[PlannedStep]
    images: int | None
    size_bytes: int | None
    worst_load_n: float
    worst_displacement_mm: float
    limits: RunLimits
    objections: list[str]
    cautions: list[str] = field(default_factory=list)
    mounting: Mounting = field(default_factory=Mounting)
    acquisition: AcquisitionPlan | None = None
    least_load_n: float | None = None
    least_displacement_mm: float | None = None

    @property
    def duration_s(self) -> float | None:
        """Estimated duration of all steps in s without the operator's work, or None if it is unknown."""
        durations = [planned.duration_s for planned in self.steps]
        return None if None in durations else math.fsum(d for d in durations if d is not None)


def make_plan(protocol: Protocol, facts: RigFacts = UNKNOWN_RIG, rig_limits: RigLimits | None = None) -> Plan:
    """Plan the longest possible run of `protocol` on a rig with the limits and sizes in `facts`.

    `rig_limits` is the table [limits] of the rig file.
    """
    steps = protocol.steps()
    per_step = protocol.images.per_step
    imaging_s = per_step * (facts.cameras or 0) * SECONDS_PER_IMAGE
    planned = [
        PlannedStep(step, _duration_s(step, motion_s, protocol, imaging_s))
        for step, motion_s in zip(steps, motion_times_s(steps, facts.speed_deg_s), strict=True)
    ]
    limits = protocol.conditions.limits
    in_force = limits_of(protocol, facts, rig_limits)
    acquisition = _acquisition(protocol, facts)
    imaged = per_step * sum(step.images for step in steps if step.acquisition is None)
    taken = kept = imaged if acquisition is None else None
    if acquisition is not None and acquisition.images is not None:
        taken = imaged + acquisition.images
    if acquisition is not None and acquisition.images_on_file is not None:
        kept = imaged + acquisition.images_on_file
    return Plan(
        title=protocol.title,
        kind=protocol.kind,
        steps=planned,
        images=None if facts.cameras is None or taken is None else taken * facts.cameras,
        size_bytes=None if facts.image_bytes is None or kept is None else kept * facts.image_bytes,
        worst_load_n=math.nan if limits is None else limits.load_max_n,
        worst_displacement_mm=math.nan if limits is None else limits.displacement_max_mm,
        limits=in_force,
        # Both lists can name the same motion. Prefer the first list, because it also names the protocol's
        # setting.
        objections=objections(protocol, facts) or in_force.objections,
        mounting=protocol.mounting,
        acquisition=acquisition,
        least_load_n=None if limits is None else limits.load_min_n,
        least_displacement_mm=None if limits is None else limits.displacement_min_mm,
    )


def _acquisition(protocol: Protocol, facts: RigFacts) -> AcquisitionPlan | None:
    found = [step.acquisition for step in protocol.steps() if step.begins]
    parts = [part for part in found if isinstance(part, Acquisition)]
    if not parts:
        return None
    ends = [
        f"until {part.end_of.text}" if part.pull is None else f"in the stages {part.pull}" for part in parts
    ]
    texts = [f"{part.schedule.text}, {end}" for part, end in zip(parts, ends, strict=True)]
    intervals_s, numbers = [part.schedule.every_s for part in parts], [part.planned for part in parts]
    kept_s = [part.schedule.keep_s for part in parts]
    return AcquisitionPlan(
        "; then ".join(texts),
        None if None in numbers else sum(number or 0 for number in numbers),
        None if None in intervals_s else min(interval_s or math.inf for interval_s in intervals_s),
        None if None in kept_s else sum(keep_s or 0.0 for keep_s in kept_s),
        facts.image_bytes,
    )


def require_feasible(plan: Plan, folder: Path) -> None:
    """Raise an error if the rig cannot execute the plan or if the images do not fit on the disk.

    Raise `ProtocolError` if the plan has objections, `folder` does not exist, the disk has too little free
    space, or the file system or a limit of the process does not allow such a large file.
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
    needed = int((plan.size_bytes or 0) * _SPACE_MARGIN)
    try:
        free, largest = shutil.disk_usage(folder).free, largest_file_bytes(folder)
    except OSError as error:
        got, remedy = error.strerror or str(error), "name another folder with -o"
        raise ProtocolError(str(folder), "a folder that files can be created in", got, remedy) from error
    if needed > free:
        raise ProtocolError(
            str(folder),
            f"{format_bytes(needed)} of free space for the run",
            format_bytes(free),
            "free disk space, or name a folder on another disk with -o",
        )
    if needed > largest:
        raise ProtocolError(
            str(folder),
            f"a run file of {format_bytes(needed)}",
            f"a volume or a limit (`ulimit -f`) that allows no file above {format_bytes(largest)}",
            "raise the limit with `ulimit -f unlimited`, or name a folder on another volume with -o",
        )


def format_bytes(size: int) -> str:
    """Return a size in bytes as text, in MB or GB."""
    return f"{size / 1e6:.1f} MB" if size < 1e9 else f"{size / 1e9:.1f} GB"


def _duration_s(
    step: ProtocolStep, motion_s: float | None, protocol: Protocol, imaging_s: float
) -> float | None:
    part = step.acquisition
    if isinstance(part, Acquisition) and part.pull is not None:
        return None  # what the specimen does ends its stages
    if isinstance(protocol, AcquireProtocol) and step.acquisition is not None and not step.timed:
        # the one step that stands for all images at unknown times
        end, every_s = protocol.end, protocol.acquire.every_s
        if every_s is not None and end.images is not None:
            return min(every_s * (end.images - 1), end.duration_s or math.inf)
        return end.duration_s
    return None if motion_s is None else motion_s + _still_s(step, protocol, imaging_s)


def _still_s(step: ProtocolStep, protocol: Protocol, imaging_s: float) -> float:
    if step.timed:
        return 0.0  # without a dwell time, because images are taken during the motion
    return protocol.settle.dwell_s + (imaging_s if step.images else 0.0)
