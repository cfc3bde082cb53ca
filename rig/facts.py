"""What a rig can do: first by its rig file, then by its opened devices."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from drivers.interfaces import CameraInfo
from rig.devices import Rig
from rig.protocol.protocol import Protocol, TensionProtocol
from rig.rigfile import RigFile


@dataclass(frozen=True)
class RigFacts:
    """Limits and sizes that a plan is checked against; None where a value is unknown.

    `image_bytes` is the sum over one image from each camera.
    """

    has_stage: bool | None = None
    has_load_frame: bool | None = None
    cameras: int | None = None
    image_bytes: int | None = None
    load_max_n: float | None = None
    displacement_max_mm: float | None = None
    speed_max_mm_s: float | None = None
    load_rate_max_n_s: float | None = None
    angle_min_deg: float | None = None
    angle_max_deg: float | None = None
    speed_deg_s: float | None = None


UNKNOWN_RIG = RigFacts()


def facts_of_file(rig_file: RigFile) -> RigFacts:
    """Collect the limits and sizes among the drivers' settings, by their usual names; no device is opened."""
    facts: dict[str, float | None] = {}
    if rig_file.load_frame is not None:
        for name in ("load_max_n", "displacement_max_mm", "speed_max_mm_s", "load_rate_max_n_s"):
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
        cameras=len(sizes),
        image_bytes=None if any(None in size for size in sizes) else sum(_bytes(*size) for size in sizes),
        **facts,
    )


def confirm(facts: RigFacts, rig: Rig) -> RigFacts:
    """Replace the values of the rig file by those of the opened devices."""
    infos: list[CameraInfo] = [camera.info for camera in rig.cameras.values()]
    image_bytes = sum(_bytes(info.width_px, info.height_px, info.bits) for info in infos)
    facts = replace(facts, image_bytes=image_bytes, cameras=len(infos))
    if rig.load_frame is None:
        return facts
    limits = rig.load_frame.limits
    return replace(
        facts,
        load_max_n=limits.load_max_n,
        displacement_max_mm=limits.displacement_max_mm,
        speed_max_mm_s=limits.speed_max_mm_s,
        load_rate_max_n_s=limits.load_rate_max_n_s,
    )


def objections(protocol: Protocol, facts: RigFacts) -> list[str]:
    """Return one sentence for each demand of the protocol that the rig cannot meet."""
    if isinstance(protocol, TensionProtocol):
        if facts.has_load_frame is False:
            return ["a tension protocol needs a [load_frame] in the rig file; add it, or take another rig"]
        limits, loading, stretching = protocol.limits, protocol.loading, protocol.stretching
        return _above(
            [
                ("limits.load_max_n", limits.load_max_n, facts.load_max_n, "N"),
                ("limits.displacement_max_mm", limits.displacement_max_mm, facts.displacement_max_mm, "mm"),
                ("loading.rate_n_s", loading.rate_n_s, facts.load_rate_max_n_s, "N/s"),
                ("stretching.speed_mm_s", stretching.speed_mm_s, facts.speed_max_mm_s, "mm/s"),
            ]
        )
    if facts.has_stage is False:
        return ["a rotation protocol needs a [stage] in the rig file; add it, or take another rig"]
    rotation, settle = protocol.rotation, protocol.settle
    found = _above([("rotation.total_deg", rotation.total_deg, facts.angle_max_deg, "deg")])
    if facts.angle_min_deg is not None and facts.angle_min_deg > 0.0:
        found.append(
            f"the reference is at 0 deg, but stage.angle_min_deg is {facts.angle_min_deg:g}; set that to 0"
        )
    if facts.speed_deg_s is not None:
        needed_s = rotation.increment_deg / facts.speed_deg_s + settle.dwell_s
        if needed_s > settle.timeout_s:
            found.append(
                f"settle.timeout_s is {settle.timeout_s:g}, but a step and its dwell take {needed_s:g} s; "
                f"set it above {needed_s:g}"
            )
    return found


def _above(wishes: Sequence[tuple[str, float, float | None, str]]) -> list[str]:
    return [
        f"{name} is {wanted:g}, but the rig allows {allowed:g} {unit} at most; set it to {allowed:g} or less"
        for name, wanted, allowed, unit in wishes
        if allowed is not None and wanted > allowed
    ]


def _bytes(width_px: int, height_px: int, bits: int) -> int:
    return width_px * height_px * (1 if bits <= 8 else 2)
