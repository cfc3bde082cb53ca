"""Replay a run with the same protocol, engine and recorder. The devices return the recorded data."""

import json
import math
import shlex
import sys
import tempfile
import tomllib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime, timedelta
from functools import partial
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from dic.runfile import schema
from dic.runfile.reader import RunFile
from drivers.clock import VirtualClock
from drivers.errors import DeviceError
from drivers.interfaces import CameraInfo, DeviceInfo, Frame, LoadFrameState, StageState
from rig.devices import OpenedInterlock, Rig
from rig.engine.engine import Engine
from rig.engine.status import Outcome
from rig.mounting import Mounting
from rig.protocol.protocol import Protocol, recorded_protocol
from rig.recorder import Recorder, RunHeader
from rig.recorder.header import interlock_records
from rig.replay.compare import differences
from rig.replay.devices import (
    RecordedReadings,
    ReplayedCamera,
    ReplayedInterlock,
    ReplayedLoadFrame,
    ReplayedOperator,
    ReplayedStage,
    end_of_record,
)
from rig.replay.pauses import RecordedPauses
from rig.replay.recorded_limits import limits_of_load_frame, limits_of_rig
from rig.replay.script import Script, of_another_version, require_commanded

_POLL_S = 1e-3
"""Short time in s between two readings of the replay, because each reading waits until its recorded time."""
_NEVER_S = 1e12


@dataclass(frozen=True)
class Replay:
    """The result of a replay.

    Attributes
    ----------
    outcome : Outcome
        How the replay ended.
    recorded_status : str
        The status of the recorded run.
    images, readings, steps : int
        Number of images, readings and steps in the new run file.
    differences : list of str
        One sentence for each difference between the run and its replay. The list is empty if both are
        identical.
    """

    outcome: Outcome
    recorded_status: str
    images: int
    readings: int
    steps: int
    differences: list[str]


def replay_run(path: str | Path, new_path: str | Path | None = None) -> Replay:
    """Replay an archived run on simulated time, and compare images, readings and steps bit by bit.

    Parameters
    ----------
    path : str or Path
        The run file. The run may have been aborted, or killed and repaired.
    new_path : str or Path, optional
        The new run file of the replay. Without it, the replay writes into a temporary folder.

    Raises
    ------
    RunFileError
        If the file cannot be read.
    RigError
        If the run file lacks data that a replay needs, its images were taken at times or events of channels,
        or the new file cannot be written.

    Notes
    -----
    The samples of channels beside a commanded test are not replayed, and the new file has none.
    """
    with _place(new_path) as place, RunFile(path) as run:
        protocol = _protocol(run)
        require_commanded(run, protocol)
        outcome = _feed(Script.of(run), protocol, place)
        with RunFile(place) as replayed:
            found = differences(run, replayed)
            images = sum(len(replayed.rows_on_file(name)) for name in replayed.cameras)
            names = [f"instrument/{name}" for name in ("stage", "load_frame")]
            names += [f"interlocks/{name}" for name in replayed.interlocks]
            tables = [replayed.columns(name) for name in names]
            readings = sum(len(table["time_s"]) for table in tables if table)
            steps = len(replayed.steps)
        return Replay(outcome, run.info.status, images, readings, steps, found)


def _feed(script: Script, protocol: Protocol, place: Path) -> Outcome:
    """Run the protocol with devices that return the recorded data, and write the new run file."""
    run = script.run
    clock = VirtualClock(script.started - timedelta(seconds=script.starts_s))
    clock.sleep(script.starts_s)
    engines: list[Engine] = []

    def ended(device: str) -> DeviceError | None:
        if run.info.status == "completed":
            return None
        if run.info.status == "aborted" and engines:
            engines[0].abort(f"the end of the record ({run.info.status_reason})")
        return end_of_record(device, run.info.status_reason or run.info.status)

    stage = load_frame = None
    readings: RecordedReadings[StageState] | RecordedReadings[LoadFrameState] | None = None
    if script.stage:
        of_stage = readings = RecordedReadings("stage", script.stage_state, clock, ended)
        stage = ReplayedStage(DeviceInfo(**run.identity("stage")), of_stage)
    if script.load_frame:
        of_frame = readings = RecordedReadings("load_frame", script.load_frame_state, clock, ended)
        info = DeviceInfo(**run.identity("load_frame"))
        load_frame = ReplayedLoadFrame(info, of_frame, limits_of_load_frame(run))
    interlocks = {}
    for name, range_of in run.interlocks.items():
        values = RecordedReadings(f"interlocks.{name}", partial(script.interlock_state, name), clock, ended)
        info = DeviceInfo(**run.identity(f"interlocks.{name}"))
        interlocks[name] = OpenedInterlock(
            ReplayedInterlock(info, range_of.unit, values),
            _bound(range_of.allowed_min),
            _bound(range_of.allowed_max),
        )
    cameras = {name: ReplayedCamera(name, _camera_info(run, name), script) for name in script.cameras}
    rig = Rig(
        clock,
        ReplayedOperator(),
        dict(cameras),
        stage,
        load_frame,
        virtual=run.info.simulated,
        call_timeout_s=_NEVER_S,
        limits=limits_of_rig(run),
        interlocks=interlocks,
    )
    assert readings is not None  # `Script.of` has checked this
    recorder = _ReplayRecorder(place, script, cameras, readings, rig)
    quick = protocol.settle.model_copy(update={"poll_s": _POLL_S})
    engine = Engine(protocol.model_copy(update={"settle": quick}), rig, recorder)
    engine.context.pauses.requests = RecordedPauses(script.pauses, lambda: readings.taken)
    engines.append(engine)
    recorder.read = engine.context.read
    return engine.run()


class _ReplayRecorder(Recorder):
    """A recorder that makes the engine take as many readings before each row as in the recorded run did.

    In the recorded run, the engine read the devices while it waited for a camera, the operator or the disk.
    """

    def __init__(
        self,
        path: Path,
        script: Script,
        cameras: dict[str, ReplayedCamera],
        readings: RecordedReadings[Any],
        rig: Rig,
    ) -> None:
        super().__init__(
            path,
            _header(script.run),
            {name: camera.info for name, camera in cameras.items()},
            stage=None if rig.stage is None else rig.stage.info,
            load_frame=None if rig.load_frame is None else rig.load_frame.info,
            interlocks=interlock_records(rig),
        )
        self.read: Callable[[], object] = lambda: None
        self._replayed = cameras
        self._counts = {name: iter(counts) for name, counts in script.readings_before.items()}
        self._readings = readings

    def frame(self, camera: str, frame: Frame, keep_s: float | None = None) -> int:
        """Append one image, after the engine has taken the readings that the record has before this image."""
        self._catch_up(camera)
        self._replayed[camera].recorded += 1
        return super().frame(camera, frame, keep_s)

    def event(self, time_s: float, level: schema.Level, source: str, message: str) -> None:
        """Append an event, after the engine has taken the readings that the record has before this event."""
        if message in self._counts:
            self._catch_up(message)
        super().event(time_s, level, source, message)

    def _catch_up(self, name: str) -> None:
        count = next(self._counts[name], 0)
        while self._readings.taken < count:
            self.read()


def _protocol(run: RunFile) -> Protocol:
    try:
        return recorded_protocol(run.info.definition, [step.kind for step in run.steps])
    except (tomllib.TOMLDecodeError, ValidationError, RecursionError) as error:
        raise of_another_version(run, "protocol", error) from error


def _bound(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _camera_info(run: RunFile, name: str) -> CameraInfo:
    height_px, width_px = run.image_shape(name)
    identity = run.identity(name)
    bits = int(identity.pop("bits"))
    return CameraInfo(**identity, width_px=width_px, height_px=height_px, bits=bits)


def _header(run: RunFile) -> RunHeader:
    info = run.info
    protocol = _protocol(run)
    return RunHeader(
        title=info.title,
        run_id=info.run_id,
        definition=info.definition,
        configuration=info.configuration,
        start=datetime.fromisoformat(info.start_time),
        versions=info.versions,
        sample=protocol.sample,
        grid=protocol.grid,
        simulated=info.simulated,
        provenance=json.dumps({"command": shlex.join(sys.argv), "replay_of": info.run_id}),
        mounting=_mounting(run),
    )


def _mounting(run: RunFile) -> Mounting:
    mounting = run.mounting
    return Mounting(
        plate_mm=mounting.plate_mm,
        tilt_axis_mm=None if mounting.tilt_axis_mm is None else list(mounting.tilt_axis_mm),
        shift_std_um=mounting.shift_std_um,
        fixed_face=mounting.fixed_face,
    )


@contextmanager
def _place(new_path: str | Path | None) -> Iterator[Path]:
    if new_path is not None:
        yield Path(new_path)
        return
    with tempfile.TemporaryDirectory(prefix="offaxis-replay-") as folder:
        yield Path(folder) / "replay.h5"
