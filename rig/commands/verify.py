"""Reading a run file to the last byte: what is there, what is damaged, what is missing."""

import tomllib
from dataclasses import dataclass
from pathlib import Path

from pydantic import ValidationError

from dic.runfile.reader import RunFile, RunInfo
from rig.protocol.protocol import parse_protocol
from rig.protocol.step import ProtocolStep


@dataclass(frozen=True)
class CameraCheck:
    """Images of one camera: those on file, those of finished steps, and the rows that cannot be read."""

    valid: int
    in_steps: int
    damaged: list[int]


@dataclass(frozen=True)
class Verification:
    """What a run file holds.

    Attributes
    ----------
    status, reason : str
        As in the file; a run that was cut off still says "running".
    steps, planned : int
        Number of finished steps, and number of steps in the plan's worst case.
    cameras : dict of str to CameraCheck
    problems : list of str
        One sentence each; empty for a completed run without damage.
    """

    path: Path
    status: str
    reason: str
    steps: int
    planned: int
    cameras: dict[str, CameraCheck]
    problems: list[str]


def verify_run(path: str | Path) -> Verification:
    """Read every image of a run file and check it against its checksum.

    Also reads a run that is being recorded and one whose program was killed.

    Raises
    ------
    RunFileError
        If the file is missing, cut off before its tables, or not a run file.
    """
    with RunFile(path) as run:
        planned = _planned(run.info.definition)
        status, done = run.info.status, len(run.steps)
        problems = [] if status == "completed" else [_unfinished(run.info, done, len(planned))]
        kinds = [step.kind for step in run.steps]
        problems += [
            f"step of kind {kind}: 1 expected, {kinds.count(kind)} on file"
            for kind in ("grid", "reference")
            if kinds.count(kind) != 1
        ]
        cameras = {name: _check_camera(run, name, problems) for name in run.cameras}
        return Verification(run.path, status, run.info.status_reason, done, len(planned), cameras, problems)


def _check_camera(run: RunFile, name: str, problems: list[str]) -> CameraCheck:
    """Check the images of a camera; append each problem to `problems`."""
    on_file, damaged = run.rows_on_file(name), run.damaged_rows(name)
    in_steps = [row for step in run.steps for row in run.rows(name, step)]
    missing = sorted(set(in_steps) - set(on_file))
    if damaged:
        problems.append(f"{name}: images {_listed(damaged)} cannot be read or fail their checksum")
    if missing:
        problems.append(f"{name}: images {_listed(missing)} of finished steps are missing")
    return CameraCheck(len(on_file), len(in_steps), damaged)


def _planned(definition: str) -> list[ProtocolStep]:
    try:
        return parse_protocol(tomllib.loads(definition)).steps()
    except (tomllib.TOMLDecodeError, ValidationError):
        return []


def _unfinished(info: RunInfo, done: int, planned: int) -> str:
    running = info.status == "running"
    how = "is running, or was cut off" if running else f"{info.status}: {info.status_reason}"
    return f"the run {how}; {done} of {planned} planned steps are on file"


def _listed(rows: list[int]) -> str:
    shown = ", ".join(str(row) for row in rows[:10])
    return shown if len(rows) <= 10 else f"{shown} and {len(rows) - 10} more"
