"""Plan a motion by hand: its target, its rate, and the range in which all readings must stay."""

import math
from dataclasses import dataclass, replace

from drivers.interfaces import LoadFrameLimits
from rig import Rig, RigError, RigReading
from rig.facts import RigFacts
from rig.limit_settings import RigLimits
from rig.limits.by_hand import (
    DISPLACEMENT_TOLERANCE_MM,
    LOAD_TOLERANCE_SHARE,
    LOADED_SHARE,
    HandMotion,
    hand_string,
    plausible_travel_mm,
    speed_of_load_mm_s,
)
from rig.rigfile import RigFile

UNLOADED_SHARE = 0.01
"""Default load rate per second, as a fraction of the largest load. A ramp from 0 to this load takes 100 s."""
SPEED_SHARE = 0.01
"""Default travel of the crosshead per second, as a fraction of the displacement range."""
OVERSHOOT_SHARE = 0.02
"""The load may leave the range from start to target by this fraction of the largest load."""
OVERSHOOT_MM = 0.05
ANGLE_TOLERANCE_DEG = 0.02


@dataclass(frozen=True)
class Wish:
    """The motion that a person asks for: a target of one axis, absolute or relative to the reading.

    `rate` is in N/s or mm/s. None means the slow default rate. `travel_max_mm` is the largest travel of the
    crosshead on the way to a load. None means the travel that is plausible for the load. `free` says that no
    specimen is in the grips.
    """

    axis: str
    target: float
    relative: bool = False
    rate: float | None = None
    travel_max_mm: float | None = None
    free: bool = False


def plan(wish: Wish, reading: RigReading, rig: Rig, facts: RigFacts) -> HandMotion:
    """Return the motion that a person has asked for.

    Raise `RigError` if the target or the rate is beyond the limits of the rig.
    """
    if wish.axis == "angle":
        return _turn(wish, reading, facts)
    assert rig.load_frame is not None  # `move` has checked that the rig has this device
    limits = rig.load_frame.limits
    if wish.axis == "load":
        return _load(wish, reading, limits, rig.limits)
    return _travel(wish, reading, limits)


def slowed(rig_file: RigFile, wish: Wish) -> RigFile:
    """Return the rig file with a low speed limit of the load frame: the speed that a motion to a load needs.

    With this limit the machine moves slowly even if the load cell shows less than the real load.
    """
    entry = rig_file.load_frame
    if entry is None or wish.axis != "load":
        return rig_file
    known, load_max_n = entry.setting("speed_max_mm_s"), entry.setting("load_max_n")
    if not isinstance(known, float) or not isinstance(load_max_n, float):
        return rig_file
    rate_n_s = UNLOADED_SHARE * load_max_n if wish.rate is None else wish.rate
    if not rate_n_s > 0.0:  # change nothing, because the plan of the motion refuses this rate
        return rig_file
    slower = min(known, speed_of_load_mm_s(rig_file.limits, rate_n_s))
    settings = entry.settings.model_copy(update={"speed_max_mm_s": slower})
    return replace(rig_file, load_frame=replace(entry, settings=settings))


def _load(wish: Wish, reading: RigReading, limits: LoadFrameLimits, rig_limits: RigLimits) -> HandMotion:
    if limits.load_rate_max_n_s == 0.0:
        raise RigError(
            "the motion to a load",
            "a load frame that controls the load",
            "one that only moves to displacements",
            "move with rig jog --displacement-mm",
        )
    target = wish.target + (reading.load_n if wish.relative else 0.0)
    rate = _rate(wish, UNLOADED_SHARE * limits.load_max_n, limits.load_rate_max_n_s, "N/s")
    _require_within(target, limits.load_min_n, limits.load_max_n, "load", "N")
    spare_n = OVERSHOOT_SHARE * limits.load_max_n
    low_mm, high_mm = plausible_travel_mm(
        hand_string(rig_limits, reading.load_n, limits.load_max_n), reading.load_n, target
    )
    if wish.travel_max_mm is not None:
        low_mm, high_mm = -wish.travel_max_mm, wish.travel_max_mm
    return HandMotion(
        f"go from {reading.load_n:.1f} to {target:g} N at {rate:g} N/s",
        "load",
        target,
        LOAD_TOLERANCE_SHARE * limits.load_max_n,
        rate,
        abs(target - reading.load_n) / rate,
        load_n=(min(target, reading.load_n) - spare_n, max(target, reading.load_n) + spare_n),
        displacement_mm=(reading.displacement_mm + low_mm, reading.displacement_mm + high_mm),
        load_max_n=limits.load_max_n,
    )


def _travel(wish: Wish, reading: RigReading, limits: LoadFrameLimits) -> HandMotion:
    start_mm = reading.displacement_mm
    target = wish.target + (start_mm if wish.relative else 0.0)
    range_mm = limits.displacement_max_mm - limits.displacement_min_mm
    rate = _rate(wish, SPEED_SHARE * range_mm, limits.speed_max_mm_s, "mm/s")
    _require_within(target, limits.displacement_min_mm, limits.displacement_max_mm, "displacement", "mm")
    load_n = limits.load_min_n, limits.load_max_n
    if wish.free:
        spare_n = LOADED_SHARE * limits.load_max_n
        load_n = reading.load_n - spare_n, reading.load_n + spare_n
    return HandMotion(
        f"go from {start_mm:.4f} to {target:g} mm at {rate:g} mm/s",
        "displacement",
        target,
        DISPLACEMENT_TOLERANCE_MM,
        rate,
        abs(target - start_mm) / rate,
        load_n=load_n,
        displacement_mm=(min(target, start_mm) - OVERSHOOT_MM, max(target, start_mm) + OVERSHOOT_MM),
        load_max_n=None if wish.free else limits.load_max_n,
    )


def _turn(wish: Wish, reading: RigReading, facts: RigFacts) -> HandMotion:
    target = wish.target + (reading.angle_deg if wish.relative else 0.0)
    low = -math.inf if facts.angle_min_deg is None else facts.angle_min_deg
    high = math.inf if facts.angle_max_deg is None else facts.angle_max_deg
    _require_within(target, low, high, "angle", "deg")
    speed_deg_s = facts.speed_deg_s or 1.0
    return HandMotion(
        f"turn from {reading.angle_deg:.2f} to {target:g} deg",
        "rotation",
        target,
        ANGLE_TOLERANCE_DEG,
        math.nan,
        abs(target - reading.angle_deg) / speed_deg_s,
    )


def _rate(wish: Wish, slow: float, greatest: float, unit: str) -> float:
    rate = min(slow, greatest) if wish.rate is None else wish.rate
    if not 0.0 < rate <= greatest:
        raise RigError(
            "the rate",
            f"a rate above 0 up to {greatest:g} {unit}",
            f"{rate:g} {unit}",
            f"give --rate {min(slow, greatest):g}, or leave it out",
        )
    return rate


def _require_within(target: float, low: float, high: float, name: str, unit: str) -> None:
    # Write `not <=` instead of `>`, because NaN must be refused too.
    if not low <= target <= high:
        raise RigError(
            f"the target of the {name}",
            f"a {name} from {low:g} to {high:g} {unit}, the limits of the rig",
            f"{target:g} {unit}",
            f"give a target within these limits, such as {max(low, min(high, 0.0)):g}",
        )
