"""Continue a run that ended early, in a new run file that contains the digest of the earlier file.

The engine follows the protocol from its beginning. Finished steps are not executed again. For these steps the
protocol gets the recorded readings instead of new ones, so it makes the same decisions again.
"""

import json
import math
import re
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from dic.files.digest import file_sha256
from dic.runfile import superblock
from dic.runfile.joined import JoinedRun, open_run
from dic.runfile.lock import is_recorded
from dic.runfile.reader import RunFile
from rig.devices import Rig
from rig.errors import ProtocolError, RigError
from rig.protocol.protocol import Protocol, recorded_protocol
from rig.protocol.step import ProtocolStep, RigReading
from rig.recorder.records import PHASE_ENDED, STEP_MISSED, STEP_REACHED

_TOLERANCES = 5.0
"""Largest accepted change of load, displacement or angle since the earlier run, in settling tolerances."""
_LOAD_FRACTION = 0.1
"""The load may change by this fraction in addition, because a specimen relaxes while it is held."""
_COLUMNS = ("time_s", "load_n", "displacement_mm", "angle_deg")


class ContinueError(RigError):
    """The earlier run cannot be continued."""


@dataclass(frozen=True)
class FinishedPart:
    """The finished part of a run."""

    path: Path
    protocol: Protocol  # the protocol that the earlier run followed
    # the identity of the run, and the SHA-256 of its whole file
    run_id: str
    sha256: str
    # the settled readings of the finished steps, by the step's number in the plan
    readings: dict[int, RigReading]
    next: ProtocolStep  # the first step that is not finished
    end: RigReading  # the last reading of the run
    # the identity of each device of the earlier run, such as its serial number
    identities: dict[str, dict[str, object]]

    def record(self, start: RigReading) -> str:
        """Return the JSON about the earlier run for the new run file."""
        names = ("load_n", "displacement_mm", "angle_deg")
        readings = {"ended": asdict(self.end), "begins": asdict(start)}
        return json.dumps(
            {
                "file": self.path.name,
                "sha256": self.sha256,
                "run_id": self.run_id,
                "steps": sorted(self.readings),
                **{
                    when: {name: None if math.isnan(values[name]) else values[name] for name in names}
                    for when, values in readings.items()
                },
            }
        )


def read_earlier(path: Path, definition: str, configuration: str) -> FinishedPart:
    """Read and verify the finished part of a run.

    `path` is the file of the earlier run, which was aborted, failed, or was killed and repaired. `definition`
    and `configuration` are the text of the protocol file and of the rig file, which must be the same as in
    the earlier run. Raise `RunFileError` if the file cannot be read, and `ContinueError` if the file is
    damaged, belongs to another protocol or rig file, or has no unfinished step that can be continued.
    """

    def refuse(expected: str, got: str, remedy: str) -> ContinueError:
        return ContinueError(f"going on with {path}", expected, got, remedy)

    with open_run(path) as run:
        if is_recorded(path):
            raise refuse("a run that has ended", "one that a program records now", "wait for its end")
        if not superblock.is_closed(path):
            raise refuse("a closed run file", "one whose program was killed", f"first use rig repair {path}")
        if run.info.status == "completed":
            raise refuse("a run that ended early", "a completed one", "start the protocol anew")
        damaged = [name for name in run.cameras if run.damaged_rows(name)]
        if damaged or run.digest_matches() is False:
            got = f"damaged images of {', '.join(damaged)}" if damaged else "a file that was changed later"
            raise refuse("a verified run file", got, f"look at it with rig verify {path}; start anew")
        for what, ours, theirs in (
            ("protocol", definition, run.info.definition),
            ("rig file", configuration, run.info.configuration),
        ):
            if ours != theirs:
                raise refuse(
                    f"the {what} of the earlier run",
                    "another text",
                    f"give the {what} unchanged; the run file has a copy of its text",
                )
        # Runs of earlier versions have no still images.
        protocol = recorded_protocol(definition, [step.kind for step in run.steps])
        if protocol.takes_acquisitions:
            remedy = "begin a new run; both files have their images, times and samples"
            raise refuse("a protocol of single steps", "images at times or events", remedy)
        readings = _finished(run)
        following = _following(protocol, readings)
        if 1 not in readings or following is None:
            got = "no reference" if following is not None else "no step that is left"
            raise refuse("a grid, a reference, and a step that is left", got, "start the protocol anew")
        if isinstance(following, str):
            raise refuse("an interruption between two commanded steps", following, "start the protocol anew")
        channels = [f"channels.{name}" for name in run.channels]
        identities = {name: run.identity(name) for name in (*run.cameras, *channels)}
        end = {"load_n": math.nan, "displacement_mm": math.nan, "angle_deg": math.nan}
        for device in ("stage", "load_frame"):
            if table := run.columns(f"instrument/{device}"):
                identities[device] = run.identity(device)
                end |= {name: float(table[name][-1]) for name in end if name in table and len(table[name])}
        digest = file_sha256(path)
        last = RigReading(0.0, end["load_n"], end["displacement_mm"], end["angle_deg"])
        known = digest, readings, following, last, identities
        return FinishedPart(path, protocol, run.info.run_id, *known)


def require_unchanged(earlier: FinishedPart, protocol: Protocol, rig: Rig) -> RigReading:
    """Check that devices and readings are those at the end of the earlier run. Return the present reading.

    Raise `ContinueError` if a device was replaced, or if load, displacement or angle have changed since the
    end of the earlier run.
    """
    devices: dict[str, Any] = {"stage": rig.stage, "load_frame": rig.load_frame, **rig.cameras}
    devices |= {f"channels.{name}": device for name, device in rig.channels.items()}
    for name, identity in earlier.identities.items():
        info = getattr(devices.get(name), "info", None)
        ours = (getattr(info, "vendor", ""), getattr(info, "model", ""), getattr(info, "serial", ""))
        theirs = (identity.get("vendor"), identity.get("model"), identity.get("serial"))
        if ours != theirs:
            raise ContinueError(
                f"going on with {earlier.path}, {name}",
                " ".join(map(str, theirs)),
                " ".join(map(str, ours)) if info else "no such device",
                "connect the device of the earlier run, or start the protocol anew",
            )
    state = None if rig.load_frame is None else rig.load_frame.read()
    stage = None if rig.stage is None else rig.stage.read()
    start = RigReading(
        rig.clock.now_s(),
        math.nan if state is None else state.load_n,
        math.nan if state is None else state.displacement_mm,
        math.nan if stage is None else stage.angle_deg,
    )
    zeroing = protocol.conditions.zeroing
    if zeroing is not None:
        end = earlier.end
        load_n = max(_TOLERANCES * zeroing.load_tolerance_n, _LOAD_FRACTION * abs(end.load_n))
        way_mm = _TOLERANCES * zeroing.displacement_tolerance_mm
        for name, unit, now, then, most in (
            ("load", "N", start.load_n, end.load_n, load_n),
            ("displacement", "mm", start.displacement_mm, end.displacement_mm, way_mm),
        ):
            if not abs(now - then) <= most:
                raise ContinueError(
                    f"going on with {earlier.path}, {name}",
                    f"{then:.6g} ± {most:.3g} {unit}, where the earlier run ended",
                    f"{now:.6g} {unit}",
                    "the specimen or the zero of the machine has changed meanwhile: start the protocol anew",
                )
    return start


def _finished(run: RunFile) -> dict[int, RigReading]:
    """Return the readings of the finished steps, with and without images, by the steps' numbers."""
    earlier, steps = (run.earlier, run.own_steps) if isinstance(run, JoinedRun) else (None, run.steps)
    readings = {} if earlier is None else _finished(earlier)
    for step in steps:
        readings[step.index] = RigReading(step.time_s, step.load_n, step.displacement_mm, step.angle_deg)
    events = run.columns("events")
    # Run files of earlier versions do not record the order of rows, so leave the events out.
    rows = list(zip(events["message"], events["order"], strict=True)) if "order" in events else []
    for beginning in (STEP_REACHED, STEP_MISSED, PHASE_ENDED):
        said = re.compile(rf"{re.escape(beginning)} (\d+)")
        for message, order in rows:
            if found := said.match(message.decode(errors="replace")):
                index = int(found[1])
                # Take a reading from before the event if the run ended before the images of the step were
                # taken.
                known = readings.get(index) or _reading_before(run, int(order))
                readings[index] = replace(known, ends_phase=beginning == PHASE_ENDED)
    return readings


def _reading_before(run: RunFile, order: int) -> RigReading:
    """Return the last reading that was recorded before the row with the number `order`."""
    values = dict.fromkeys(_COLUMNS, math.nan)
    for device in ("stage", "load_frame"):
        table = run.columns(f"instrument/{device}")
        row = int(np.searchsorted(table["order"], order)) - 1 if table else -1
        if row >= 0:
            values |= {name: float(table[name][row]) for name in _COLUMNS if name in table}
    time_s, load_n, displacement_mm, angle_deg = values.values()
    return RigReading(time_s, load_n, displacement_mm, angle_deg)


def _following(protocol: Protocol, readings: dict[int, RigReading]) -> ProtocolStep | str | None:
    """Return the first unfinished step, or the reason why the run cannot continue there.

    If all steps are finished, return None.
    """

    class Found(Exception):
        pass

    found: list[ProtocolStep] = []
    last = max(readings, default=-1)

    def recall(step: ProtocolStep) -> RigReading:
        if step.passed:
            return RigReading(0.0)  # return any reading, because a step that is left out has none
        if step.index not in readings:
            found.append(step)
            raise Found
        return readings[step.index]

    try:
        protocol.follow(recall)
    except Found:
        step = found[0]
    except ProtocolError as error:
        return str(error)
    else:
        return None
    if not step.images and step.index < last:
        return "cycles without images, whose readings are not known"
    if not step.begins:
        return f"the middle of a motion or a hold, before {step}"
    return step


def require_same_folder(earlier: FinishedPart, run_path: Path) -> None:
    """Require that the new run file is in the same folder as the earlier one.

    Raise `ContinueError` if the folders differ. `dic process` looks for the earlier file beside the new one.
    """
    if run_path.resolve().parent != earlier.path.resolve().parent:
        raise ContinueError(
            f"going on with {earlier.path}",
            f"a new run file in {earlier.path.resolve().parent}",
            str(run_path),
            "name another file with -o",
        )
