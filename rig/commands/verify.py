"""Verify a run file: read every image, and report damaged, missing or contradictory content."""

import hashlib
import math
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from dic.pipeline.image_timing import ImageTiming
from dic.runfile.at_exposure import steps_at_exposure
from dic.runfile.lock import is_recorded
from dic.runfile.reader import RunFile, RunInfo
from dic.runfile.schema import Moment
from rig.commands.verify_channels import ChannelCheck, check_channels, missing_channels
from rig.protocol.acquire import AcquireProtocol
from rig.protocol.protocol import Protocol, recorded_protocol

_MOST_STEPS = 10
"""More steps without an image have one sentence together."""
_READINGS = {"load": "load_n", "displacement": "displacement_mm", "rotation": "angle_deg"}


@dataclass(frozen=True)
class CameraCheck:
    """Numbers of a camera's images in the file and in finished steps, and the rows of its damaged images."""

    valid: int
    in_steps: int
    damaged: list[int]


@dataclass(frozen=True)
class InterlockCheck:
    """Number of an interlock's readings in the file, and how many of them are outside its allowed range."""

    readings: int
    outside: int


@dataclass(frozen=True)
class Verification:
    """The result of `rig verify` for one run file.

    Attributes
    ----------
    status, reason : str
        Status and reason from the run file. The status of a run whose program was killed is still "running".
    steps : int
        Number of finished steps whose images are in the file.
    planned : int or None
        Number of steps in the longest possible run, None if events decide it.
    cameras : dict of str to CameraCheck
    problems : list of str
        One sentence for each problem. The list is empty for a completed run without damage.
    digest : str
        Result of the check of the file's own digest, which covers everything but the images: "right", "wrong"
        or "none". With "none" the file has no digest, because an old program recorded it or no program closed
        it.
    interlocks : dict of str to InterlockCheck
    channels : dict of str to ChannelCheck
    overwritten : int
        Number of finished steps whose images were overwritten by later ones, as the protocol asks for.
    timing : dict of str to ImageTiming
        How well the images of each camera kept the times at which they were due.
    """

    path: Path
    status: str
    reason: str
    steps: int
    planned: int | None
    cameras: dict[str, CameraCheck]
    problems: list[str]
    digest: str = "none"
    interlocks: dict[str, InterlockCheck] = field(default_factory=dict)
    channels: dict[str, ChannelCheck] = field(default_factory=dict)
    overwritten: int = 0
    timing: dict[str, ImageTiming] = field(default_factory=dict)


def verify_run(path: str | Path) -> Verification:
    """Read every image of a run file. Check each image against its digest, and the file against its own one.

    Everything that `dic process` needs is checked too. The run may still be in progress, or its program may
    have been killed.

    Raises
    ------
    RunFileError
        If the file is missing, is too short to contain the tables, or is not a run file.
    """
    with RunFile(path) as run:
        kinds = [step.kind for step in run.steps]
        protocol = _protocol(run.info.definition, kinds)
        planned, expected = _planned(protocol)
        status, done = run.info.status, len(run.steps) + run.overwritten
        problems = [] if status == "completed" else [_unfinished(run, done, planned)]
        problems += _check_order(run, kinds, expected)
        problems += _check_steps(run) + _check_files(run.info, protocol is not None)
        if run.overwritten and not _keeps_some(protocol):
            problems.append(f"the images of {run.overwritten} steps were overwritten by later ones")
        cameras = {name: _check_camera(run, name, problems) for name in run.cameras}
        interlocks = {name: _check_interlock(run, name, problems) for name in run.interlocks}
        channels = check_channels(run, problems)
        problems += _missing_interlocks(run) + missing_channels(run) + _missing_settings(run)
        timing = _timing(run, problems)
        matches = run.digest_matches()
        if matches is False:
            problems.append("the digest of the file is wrong: something was changed after the run")
        digest = "none" if matches is None else "right" if matches else "wrong"
        return Verification(
            run.path,
            status,
            run.info.status_reason,
            len(run.steps),
            planned,
            cameras,
            problems,
            digest,
            interlocks,
            channels,
            run.overwritten,
            timing,
        )


def _timing(run: RunFile, problems: list[str]) -> dict[str, ImageTiming]:
    """Return how well the images of each camera kept their times; append late and missing ones."""
    steps = steps_at_exposure(run, readings=False)
    found = {name: ImageTiming.of(own.steps, run.info.definition) for name, own in steps.items()}
    timings = {name: timing for name, timing in found.items() if timing is not None}
    problems += [f"{name}: {timing.text}" for name, timing in timings.items() if timing.is_late]
    return timings


def _check_order(run: RunFile, kinds: Sequence[str], expected: Sequence[str]) -> list[str]:
    """Return the problems of steps of the grid and of the reference: their number and their places."""
    if run.continues is not None:
        return []
    problems = [
        f"step of kind {kind}: {expected.count(kind)} expected, {kinds.count(kind)} on file"
        for kind in ("grid", "reference")
        if kinds.count(kind) != expected.count(kind)
    ]
    begun = [kind for kind in expected[:2] if kind in ("grid", "reference")]
    if list(kinds[: len(begun)]) != begun[: len(kinds)]:
        problems.append("the steps are out of order")
    return problems


def _check_steps(run: RunFile) -> list[str]:
    """Return the problems of steps without images or readings, and of steps out of order."""
    problems = []
    before = -1
    for step in run.steps:
        if step.index <= before:
            problems.append(f"step {step.index} follows step {before}")
        before = step.index
        reading = _READINGS.get(step.kind)
        if reading is not None and not math.isfinite(getattr(step, reading)):
            problems.append(f"step {step.index} of kind {step.kind} has no {reading}")
    for name in run.cameras:
        without = [step.index for step in run.steps if not run.rows(name, step)]
        if len(without) > _MOST_STEPS:
            problems.append(f"steps {_listed(without)} have no image of {name}")
        else:
            problems += [f"step {index} has no image of {name}" for index in without]
    return problems


def _check_files(info: RunInfo, planned: bool) -> list[str]:
    """Compare the recorded protocol and rig file with the checksum in `run_id`. Some tests record no
    protocol."""
    problems = []
    digest = hashlib.sha256((info.definition + info.configuration).encode()).hexdigest()
    _, dash, short = info.run_id.rpartition("-")
    if dash and info.definition and short != digest[: len(short)]:
        problems.append("protocol and rig file in the run do not match the checksum in the run's id")
    elif info.definition and not planned:
        problems.append("the protocol in the run cannot be read")
    return problems


def _check_interlock(run: RunFile, name: str, problems: list[str]) -> InterlockCheck:
    """Check the readings of one interlock, and append each problem to `problems`."""
    allowed, values = run.interlocks[name], run.columns(f"interlocks/{name}")["value"]
    good = (values >= allowed.allowed_min) & (values <= allowed.allowed_max)
    outside = int(np.count_nonzero(~good))
    if outside and run.info.status == "completed":
        problems.append(f"interlock {name}: {outside} readings are outside its range, but the run went on")
    machines = [run.columns(f"instrument/{device}") for device in ("load_frame", "stage")]
    expected = max((len(table["time_s"]) for table in machines if table), default=len(values))
    # The numbers may differ by one, because the run may have ended, or been killed, between two readings.
    spare = {"completed": 0, "running": expected}.get(run.info.status, 1)
    if abs(expected - len(values)) > spare:
        problems.append(f"interlock {name}: {len(values)} readings on file, {expected} of the machines")
    return InterlockCheck(len(values), outside)


def _missing_interlocks(run: RunFile) -> list[str]:
    """Return one sentence for each interlock of the rig file whose readings are missing in the run file."""
    try:
        declared = tomllib.loads(run.info.configuration).get("interlocks", {})
    except (tomllib.TOMLDecodeError, RecursionError):
        return []
    names = declared if isinstance(declared, dict) else {}
    return [f"interlock {name}: its readings are missing" for name in names if name not in run.interlocks]


def _missing_settings(run: RunFile) -> list[str]:
    """Return one sentence for each device that reports its settings, but whose settings are missing."""
    machines = [name for name in ("stage", "load_frame") if run.columns(f"instrument/{name}")]
    moments: list[Moment] = ["start", "end"] if run.info.status == "completed" else ["start"]
    return [
        f"{device}: its settings at the {moment} of the run are missing"
        for device in [*run.cameras, *machines, *(f"interlocks.{name}" for name in run.interlocks)]
        if run.steps and run.asked(device).get("reports_settings")
        for moment in moments
        if not run.settings(device, moment)
    ]


def _check_camera(run: RunFile, name: str, problems: list[str]) -> CameraCheck:
    """Check the images of one camera, and append each problem to `problems`."""
    on_file, damaged = run.rows_on_file(name), run.damaged_rows(name)
    rows_of_steps = {step.index: run.rows(name, step) for step in run.steps}
    in_steps = [row for rows in rows_of_steps.values() for row in rows]
    missing = sorted(set(in_steps) - set(on_file))
    if damaged:
        problems.append(f"{name}: images {_listed(damaged)} cannot be read or fail their checksum")
    if missing:
        problems.append(f"{name}: images {_listed(missing)} of finished steps are missing")
    if len(in_steps) != len(set(in_steps)):
        problems.append(f"{name}: some images belong to two steps")
    return CameraCheck(len(on_file), len(in_steps), damaged)


def _protocol(definition: str, kinds: Sequence[str]) -> Protocol | None:
    """Return the protocol of a run, None if it cannot be read."""
    try:
        return recorded_protocol(definition, kinds)
    except (tomllib.TOMLDecodeError, ValidationError, RecursionError):
        return None


def _planned(protocol: Protocol | None) -> tuple[int | None, list[str]]:
    """Return the number of planned steps, None if events decide it, and the kinds of these steps."""
    if protocol is None:
        return 0, ["grid", "reference"]
    kinds = [step.kind for step in protocol.steps()]
    if isinstance(protocol, AcquireProtocol):
        return protocol.planned_steps, [str(kind) for kind in kinds]
    return len(kinds), [str(kind) for kind in kinds]


def _keeps_some(protocol: Protocol | None) -> bool:
    return isinstance(protocol, AcquireProtocol) and protocol.acquire.keep_s is not None


def _unfinished(run: RunFile, done: int, planned: int | None) -> str:
    info = run.info
    how = f"{info.status}: {info.status_reason}"
    if info.status == "running":
        how = "is being recorded" if is_recorded(run.path) else "is running, or was cut off"
    of_all = "" if planned is None else f" of {planned} planned"
    return f"the run {how}; {done}{of_all} steps are on file"


def _listed(rows: list[int]) -> str:
    shown = ", ".join(str(row) for row in rows[:10])
    return shown if len(rows) <= 10 else f"{shown} and {len(rows) - 10} more"
