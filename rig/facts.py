"""Limits and image sizes of a rig, first read from the rig file and later from the opened devices."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

from drivers.interfaces import CameraInfo, LoadFrameLimits
from rig.devices import Rig
from rig.protocol.conditions import Demand
from rig.protocol.protocol import Protocol
from rig.rigfile import RigFile


@dataclass(frozen=True)
class AllowedRange:
    """The range of an interlock's value in which a run starts and continues. A missing bound is None."""

    name: str
    unit: str
    allowed_min: float | None
    allowed_max: float | None


@dataclass(frozen=True)
class RigFacts:
    """Limits and image sizes of a rig, for the check of a plan. None means that a value is unknown.

    `changes_speed` is True if the load frame can change the speed of a motion to a displacement.
    `image_bytes` is the total size of one image from each camera. `interlocks` are the allowed ranges of all
    interlocks. `signals` are the names of all measured channels.
    """

    has_stage: bool | None = None
    has_load_frame: bool | None = None
    has_measured_load: bool = False
    cameras: int | None = None
    image_bytes: int | None = None
    load_min_n: float | None = None
    load_max_n: float | None = None
    displacement_min_mm: float | None = None
    displacement_max_mm: float | None = None
    speed_max_mm_s: float | None = None
    load_rate_max_n_s: float | None = None
    changes_speed: bool | None = None
    angle_min_deg: float | None = None
    angle_max_deg: float | None = None
    speed_deg_s: float | None = None
    interlocks: tuple[AllowedRange, ...] = ()
    signals: frozenset[str] | None = None


UNKNOWN_RIG = RigFacts()
_LOAD_RATE = "load_rate_max_n_s"
_OF_LOAD_FRAME = [each.name for each in fields(LoadFrameLimits)]


def facts_of_file(rig_file: RigFile) -> RigFacts:
    """Collect the limits and the image sizes from the settings in a rig file. No device is opened.

    A value is found only if the driver uses the usual name of the setting, such as ``load_max_n``, or
    ``quantity`` for the unit of an interlock.
    """
    facts: dict[str, Any] = {}
    if rig_file.load_frame is not None:
        for name in (*_OF_LOAD_FRAME, "changes_speed"):
            facts[name] = rig_file.load_frame.setting(name)
    if rig_file.stage is not None:
        for name in ("angle_min_deg", "angle_max_deg", "speed_deg_s"):
            facts[name] = rig_file.stage.setting(name)
    sizes = [
        tuple(camera.setting(name) for name in ("width_px", "height_px", "bits"))
        for camera in rig_file.cameras.values()
    ]
    return RigFacts(
        has_stage=rig_file.stage is not None,
        has_load_frame=rig_file.load_frame is not None,
        has_measured_load=rig_file.measured_load is not None,
        cameras=len(sizes),
        image_bytes=None if any(None in size for size in sizes) else sum(_bytes(*size) for size in sizes),
        interlocks=tuple(
            AllowedRange(name, each.device.setting("quantity") or "", each.allowed_min, each.allowed_max)
            for name, each in rig_file.interlocks.items()
        ),
        signals=frozenset(rig_file.signals),
        **facts,
    )


def confirm(facts: RigFacts, rig: Rig) -> RigFacts:
    """Replace image sizes and load frame limits from the rig file with the values of the opened devices."""
    infos: list[CameraInfo] = [camera.info for camera in rig.cameras.values()]
    image_bytes = sum(_bytes(info.width_px, info.height_px, info.bits) for info in infos)
    interlocks = tuple(
        AllowedRange(name, each.device.unit, each.allowed_min, each.allowed_max)
        for name, each in rig.interlocks.items()
    )
    facts = replace(facts, image_bytes=image_bytes, cameras=len(infos), interlocks=interlocks)
    if rig.load_frame is None:
        return facts
    limits = {name: getattr(rig.load_frame.limits, name) for name in _OF_LOAD_FRAME}
    return replace(facts, **limits, changes_speed=hasattr(rig.load_frame, "change_speed"))


def narrowed(rig_file: RigFile, protocol: Protocol) -> RigFile:
    """Return the rig file with the load frame's limits narrowed to those of the protocol.

    The driver writes these limits into the machine, whose own controller then enforces them, in both
    directions.
    """
    entry, declared = rig_file.load_frame, protocol.conditions.limits
    if entry is None or declared is None:
        return rig_file
    limits = {
        "load": ("n", declared.load_max_n, declared.load_least_n),
        "displacement": ("mm", declared.displacement_max_mm, declared.displacement_least_mm),
    }
    narrower: dict[str, float] = {}
    for name, (unit, greatest, least) in limits.items():
        for setting, value, choose in (
            (f"{name}_max_{unit}", greatest, min),
            (f"{name}_min_{unit}", least, max),
        ):
            if isinstance(known := entry.setting(setting), float):
                narrower[setting] = choose(known, value)
    settings = entry.settings.model_copy(update=narrower)
    return replace(rig_file, load_frame=replace(entry, settings=settings))


def objections(protocol: Protocol, facts: RigFacts) -> list[str]:
    """Return one sentence for each requirement of the protocol that the rig does not meet."""
    conditions, settle = protocol.conditions, protocol.settle
    missing = [
        f"a {protocol.kind} protocol needs a [{device}] in the rig file; add it, or take another rig"
        for device in sorted(conditions.devices)
        if getattr(facts, f"has_{device}") is False
    ]
    if facts.has_load_frame is False and facts.has_measured_load and "load_frame" in conditions.devices:
        missing = [
            f"a {protocol.kind} protocol moves the load frame, and that of this rig is only read; use a "
            'protocol of the kind "acquire", or a rig whose [load_frame] has a driver'
        ]
    missing += [
        f"the protocol needs channels.{name}; add it to the rig file, or name another signal"
        for name in sorted(conditions.signals - facts.signals if facts.signals is not None else ())
    ]
    if missing:
        return missing
    found = _without_load_control(conditions.demands, facts)
    if conditions.strain_rates and facts.changes_speed is False:
        found.append(
            f"{', '.join(conditions.strain_rates)}: strain_rate_s needs a load frame whose driver can change "
            "the speed of a motion, and that of this rig cannot; use crosshead_strain_rate_s (method A2)"
        )
    found += [sentence for demand in conditions.demands for sentence in _beyond(demand, facts)]
    if "stage" in conditions.devices and facts.angle_min_deg is not None and facts.angle_min_deg > 0.0:
        found.append(
            f"the reference is at 0 deg, but stage.angle_min_deg is {facts.angle_min_deg:g}; set that to 0"
        )
    if facts.speed_deg_s is not None:
        for turn in conditions.turns:
            needed_s = turn.travel_deg / facts.speed_deg_s + settle.dwell_s
            if needed_s > settle.timeout_s:
                found.append(
                    f"settle.timeout_s is {settle.timeout_s:g}, but {turn.key} and its dwell take "
                    f"{needed_s:g} s; set it above {needed_s:g}"
                )
    return found


def _without_load_control(demands: Sequence[Demand], facts: RigFacts) -> list[str]:
    """Return a sentence if a protocol moves to loads, and the load frame cannot control the load."""
    keys = [demand.key for demand in demands if demand.fact == _LOAD_RATE]
    if not keys or facts.load_rate_max_n_s != 0.0:
        return []
    return [
        f"{', '.join(keys)}: a load frame that controls the load is needed, and that of this rig only moves "
        "to displacements; use motions to a displacement, or another rig"
    ]


def _beyond(demand: Demand, facts: RigFacts) -> list[str]:
    allowed: float | None = getattr(facts, demand.fact)
    if demand.fact == _LOAD_RATE and allowed == 0.0:
        return []
    if allowed is None or (demand.value >= allowed if demand.is_lowest else demand.value <= allowed):
        return []
    most, direction = ("least", "more") if demand.is_lowest else ("most", "less")
    return [
        f"{demand.key} is {demand.value:g}, but the rig allows {allowed:g} {demand.unit} at {most}; "
        f"set it to {allowed:g} or {direction}"
    ]


def _bytes(width_px: int, height_px: int, bits: int) -> int:
    return width_px * height_px * (1 if bits <= 8 else 2)
