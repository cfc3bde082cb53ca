"""Reading a run file to the last byte: what is there, what is damaged, what is missing."""

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from dic.runfile.reader import open_run
from rig.errors import RunFileError
from rig.protocol.protocol import ProtocolStep, parse_protocol
from rig.recorder import FORMAT_VERSION


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
        Finished steps, and those of the plan's worst case.
    cameras : dict of str to CameraCheck
    problems : list of str
        One sentence each; empty for a completed run that is whole.
    """

    path: Path
    status: str
    reason: str
    steps: int
    planned: int
    cameras: dict[str, CameraCheck]
    problems: list[str]


def verify_run(path: Path) -> Verification:
    """Read every image of a run file and check it against its checksum.

    Also reads a run that is being recorded and one whose program was killed.

    Raises
    ------
    RunFileError
        If the file is missing, cut off before its tables, or no run file.
    """
    if not path.is_file():
        raise RunFileError(str(path), "a run file", "no such file", "correct the name")
    try:
        with open_run(path) as file:
            if file.attrs.get("file_format") != "offaxis-run":
                raise RunFileError(str(path), "a run file", "another HDF5 file", "name another")
            if file.attrs["file_format_version"] != FORMAT_VERSION:
                raise RunFileError(
                    str(path),
                    f"format version {FORMAT_VERSION}",
                    str(file.attrs["file_format_version"]),
                    "read it with the version of the program that wrote it",
                )
            return _verify(path, file["entry"])
    except (OSError, KeyError, RuntimeError) as error:
        raise RunFileError(
            str(path),
            "a whole run file",
            f"one that is damaged or cut off ({' '.join(str(error).split())})",
            "take it from the backup",
        ) from error


def _verify(path: Path, entry: Any) -> Verification:
    status, reason = (entry[name][()].decode() for name in ("status", "status_reason"))
    steps = entry["steps"]
    done = int(steps["complete"][()].sum())
    planned = _planned(entry["definition"][()].decode())
    problems = [] if status == "completed" else [_unfinished(status, reason, done, planned)]
    kinds = [kind.decode() for kind in steps["kind"][:done]]
    problems += [
        f"step of kind {kind}: 1 expected, {kinds.count(kind)} on file"
        for kind in ("grid", "reference")
        if kinds.count(kind) != 1
    ]
    cameras = {}
    for name, group in entry["instrument"].items():
        if "data" in group:
            first, count = (steps[f"{column}_{name}"][:done] for column in ("frames", "count"))
            rows = [row for a, n in zip(first, count, strict=True) for row in range(a, a + n)]
            cameras[name] = check = _check_camera(group, rows)
            if check.damaged:
                problems.append(
                    f"{name}: images {_listed(check.damaged)} cannot be read or fail their checksum"
                )
            missing = [row for row in rows if row >= len(group["valid"]) or not group["valid"][row]]
            if missing:
                problems.append(f"{name}: images {_listed(missing)} of finished steps are missing")
    return Verification(path, status, reason, done, len(planned), cameras, problems)


def _check_camera(group: Any, rows: list[int]) -> CameraCheck:
    valid = group["valid"][()]
    damaged = []
    for row in valid.nonzero()[0]:
        try:
            group["data"][row]
        except (OSError, RuntimeError, ValueError):
            damaged.append(int(row))
    return CameraCheck(int(valid.sum()), len(rows), damaged)


def _planned(definition: str) -> list[ProtocolStep]:
    try:
        return parse_protocol(tomllib.loads(definition)).steps()
    except (tomllib.TOMLDecodeError, ValidationError):
        return []


def _unfinished(status: str, reason: str, done: int, planned: list[ProtocolStep]) -> str:
    how = "is running, or was cut off" if status == "running" else f"{status}: {reason}"
    return f"the run {how}; {done} of {len(planned)} planned steps are on file"


def _listed(rows: list[int]) -> str:
    shown = ", ".join(str(row) for row in rows[:10])
    return shown if len(rows) <= 10 else f"{shown} and {len(rows) - 10} more"
