"""Look at a rig and move it by hand, for `rig status`, `rig hold`, `rig unload` and `rig jog`."""

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from drivers.interfaces import LoadFrameLimits
from drivers.terminal.question import Question, Withdrawn
from rig import AtRest, Reading, Rig, RigError, open_rig, read_rig
from rig.engine.calls import Calls
from rig.engine.devices import called
from rig.engine.look import look
from rig.engine.manual import Manual, Motion, Moved
from rig.engine.signals import aborting_on_signals
from rig.facts import RigFacts, facts_of_file
from rig.guardian.announced import announce
from rig.guardian.guardian import guarded
from rig.guardian.lock import MachineInUse, machines_locked
from rig.rigfile import RigFile

UNLOADED_SHARE = 0.01
"""Default load rate, as a fraction of the largest load per second: from 0 to the largest load takes 100 s."""
SPEED_SHARE = 0.01
"""Default speed of the crosshead, as a fraction of the displacement range per second."""
LOAD_TOLERANCE_SHARE = 0.002
OVERSHOOT_SHARE = 0.02
"""During a motion the load may go this far beyond its start and target, as a fraction of the largest load."""
DISPLACEMENT_TOLERANCE_MM = 0.005
OVERSHOOT_MM = 0.05
ANGLE_TOLERANCE_DEG = 0.02
TRAVEL_MAX_MM = 2.0
"""Largest travel of the crosshead during a motion to a load, in case the load does not change."""


@dataclass(frozen=True)
class Wish:
    """The motion that a person asks for: the target of one axis, absolute or relative to the present reading.

    `rate` is in N/s or mm/s; None means the slow default rate.
    """

    axis: str
    target: float
    relative: bool = False
    rate: float | None = None
    travel_max_mm: float = TRAVEL_MAX_MM


@dataclass(frozen=True)
class Seen:
    """The result of `rig status`: states of the devices, failed devices, and the program that holds the
    lock."""

    at_rest: AtRest
    in_use: str = ""


def see(rig_path: Path) -> Seen:
    """Read the load frame and the stage once. If another program uses the rig, no device is opened."""
    rig_file = read_rig(rig_path)
    failed: dict[str, str] = {}
    try:
        with machines_locked(rig_file), open_rig(_machines_of(rig_file), failed=failed) as rig:
            calls = Calls(rig.clock, lambda: None, rig.lost)
            with rig.clock.activity():
                at_rest = look(called(rig, calls, lambda: None, math.inf), calls)
                calls.close()
    except MachineInUse as error:
        return Seen(AtRest(), f"{error.step} is in use by {error.got}")
    return Seen(replace(at_rest, silent=at_rest.silent | failed))


def hold(rig_path: Path) -> Moved:
    """Hold the load frame and stop the stage, without asking the user first."""
    failed: dict[str, str] = {}
    rig_file = read_rig(rig_path)
    try:
        with machines_locked(rig_file), open_rig(_machines_of(rig_file), failed=failed) as rig:
            moved = Manual(rig).hold()
    except MachineInUse as error:
        raise MachineInUse(
            error.step,
            error.expected,
            error.got,
            "press Ctrl-C in that program, or end it with kill: its end holds the load frame and stops the "
            "stage; in danger press the emergency stop",
        ) from error
    if not failed:
        return moved
    reason = f"SAFE STATE NOT CONFIRMED, use the emergency stop ({'; '.join(failed.values())})."
    at_end = replace(moved.at_end, silent=moved.at_end.silent | failed)
    return Moved("failed", f"{reason} {moved.reason}".strip(), tuple(failed.values()), at_end)


def move(
    rig_path: Path,
    wish: Wish,
    confirm: Callable[[Motion, Reading], None],
    on_reading: Callable[[Reading], None] = lambda _: None,
) -> Moved:
    """Execute one motion by hand. A signal such as Ctrl-C stops it at once.

    Raises
    ------
    RigError, DeviceError, ConfigurationError
        If the rig cannot be opened, or lacks the device. Nothing has moved before such an error.
    """
    rig_file = _without_cameras(read_rig(rig_path))
    facts = facts_of_file(rig_file)
    log = Path(f"{rig_path.stem}.guardian.log")
    with (
        machines_locked(rig_file) as locks,
        guarded(rig_file, locks, log) as guardian,
        open_rig(rig_file, guardian.relays) as opened,
    ):
        rig = announce(opened, guardian)
        _require_device(rig, wish.axis)
        manual = Manual(rig, on_reading=on_reading, on_progress=guardian.progress)
        with aborting_on_signals(manual), guardian.watched(manual.abort):
            moved = manual.move(lambda reading: plan(wish, reading, rig, facts), confirm)
        if not moved.unsafe:
            guardian.done()
    return moved


def plan(wish: Wish, reading: Reading, rig: Rig, facts: RigFacts) -> Motion:
    """Return the motion that fulfils a wish.

    Raises
    ------
    RigError
        If the target or the rate is beyond the limits of the rig.
    """
    if wish.axis == "angle":
        return _turn(wish, reading, facts)
    assert rig.load_frame is not None  # `move` has checked that the rig has this device
    limits = rig.load_frame.limits
    return _load(wish, reading, limits) if wish.axis == "load" else _travel(wish, reading, limits)


@contextmanager
def confirmation(yes: bool, word: str) -> Iterator[Callable[[Motion, Reading], None]]:
    """Yield a function that asks the user to confirm a motion by a word; with ``--yes`` it asks nothing."""
    asked: list[Question] = []

    def confirm(motion: Motion, reading: Reading) -> None:
        if yes:
            return
        now = ", ".join(f"{value:.6g} {unit}" for unit, value in reading.by_unit().items())
        text = (
            f"Now at {now}.\nThe machine will {motion.doing}, in about {motion.duration_s:.0f} s; "
            "Ctrl-C stops it."
        )
        question = Question(text, word, "Ctrl-C to leave all as it is", request="to begin")
        asked.append(question)
        try:
            question.ask()
        except (EOFError, Withdrawn):
            raise RigError(
                motion.doing,
                f'the word "{word}"',
                "no answer",
                "answer on a terminal, or confirm beforehand with --yes",
            ) from None
        finally:
            question.close()

    try:
        yield confirm
    finally:
        for question in asked:
            question.withdraw()


def _load(wish: Wish, reading: Reading, limits: LoadFrameLimits) -> Motion:
    target = wish.target + (reading.load_n if wish.relative else 0.0)
    rate = _rate(wish, UNLOADED_SHARE * limits.load_max_n, limits.load_rate_max_n_s, "N/s")
    _require_within(target, limits.load_min_n, limits.load_max_n, "load", "N")
    spare_n = OVERSHOOT_SHARE * limits.load_max_n
    travel_mm = wish.travel_max_mm
    return Motion(
        f"go from {reading.load_n:.1f} to {target:g} N at {rate:g} N/s",
        "load",
        target,
        LOAD_TOLERANCE_SHARE * limits.load_max_n,
        rate,
        abs(target - reading.load_n) / rate,
        load_n=(min(target, reading.load_n) - spare_n, max(target, reading.load_n) + spare_n),
        displacement_mm=(reading.displacement_mm - travel_mm, reading.displacement_mm + travel_mm),
    )


def _travel(wish: Wish, reading: Reading, limits: LoadFrameLimits) -> Motion:
    start_mm = reading.displacement_mm
    target = wish.target + (start_mm if wish.relative else 0.0)
    range_mm = limits.displacement_max_mm - limits.displacement_min_mm
    rate = _rate(wish, SPEED_SHARE * range_mm, limits.speed_max_mm_s, "mm/s")
    _require_within(target, limits.displacement_min_mm, limits.displacement_max_mm, "displacement", "mm")
    return Motion(
        f"go from {start_mm:.4f} to {target:g} mm at {rate:g} mm/s",
        "displacement",
        target,
        DISPLACEMENT_TOLERANCE_MM,
        rate,
        abs(target - start_mm) / rate,
        load_n=(limits.load_min_n, limits.load_max_n),
        displacement_mm=(min(target, start_mm) - OVERSHOOT_MM, max(target, start_mm) + OVERSHOOT_MM),
    )


def _turn(wish: Wish, reading: Reading, facts: RigFacts) -> Motion:
    target = wish.target + (reading.angle_deg if wish.relative else 0.0)
    low = -math.inf if facts.angle_min_deg is None else facts.angle_min_deg
    high = math.inf if facts.angle_max_deg is None else facts.angle_max_deg
    _require_within(target, low, high, "angle", "deg")
    speed_deg_s = facts.speed_deg_s or 1.0
    return Motion(
        f"turn from {reading.angle_deg:.2f} to {target:g} deg",
        "angle",
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
    # The test is `not <=`, because NaN must be refused too.
    if not low <= target <= high:
        raise RigError(
            f"the target of the {name}",
            f"a {name} from {low:g} to {high:g} {unit}, the limits of the rig",
            f"{target:g} {unit}",
            f"give a target within these limits, such as {max(low, min(high, 0.0)):g}",
        )


def _require_device(rig: Rig, axis: str) -> None:
    device = "stage" if axis == "angle" else "load_frame"
    if getattr(rig, device) is None:
        raise RigError(
            f"moving the {axis}",
            f"a [{device}] in the rig file",
            "none",
            f"name the rig file of a rig that has a {device.replace('_', ' ')}",
        )


def _without_cameras(rig_file: RigFile) -> RigFile:
    """Return the rig without its cameras, so that a specimen can be unloaded although a camera fails."""
    return replace(rig_file, cameras={})


def _machines_of(rig_file: RigFile) -> RigFile:
    """Return the rig with only stage and load frame, so that a failed interlock does not prevent a hold."""
    return replace(rig_file, cameras={}, interlocks={})
