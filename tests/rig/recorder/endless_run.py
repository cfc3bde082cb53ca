"""Record a run without an end; `test_kills` starts and kills this program."""

import os
from pathlib import Path

import numpy as np

from drivers.interfaces import DeviceInfo, LoadFrameState
from rig.protocol.step import ProtocolStep, RigReading
from rig.recorder import Recorder, StepRecord
from rig.recording import RecordingSettings
from tests.rig.recorder.forked_runs import serve
from tests.run_files import CAMERAS, HEADER, take

FRAMES = 3
STEPS_MAX = 100_000


def number_of(index: int, camera: int, frame: int) -> int:
    """Return the number that an image shows, from its step, its camera and its number within the step."""
    return (index * len(CAMERAS) + camera) * FRAMES + frame


def record(path: Path) -> None:
    """Record steps as fast as the disk acknowledges them."""
    settings = RecordingSettings(sync_frames=2)
    recorder = Recorder(path, HEADER, CAMERAS, load_frame=DeviceInfo("v", "m", "s"), settings=settings)
    for index in range(STEPS_MAX):
        frames = {}
        for camera, (name, info) in enumerate(CAMERAS.items()):
            rows = [recorder.frame(name, take(info, number_of(index, camera, k))) for k in range(FRAMES)]
            frames[name] = (rows[0], FRAMES)
            recorder.load_frame_state(
                LoadFrameState(float(index), 0.1, False, True, True, index, (), float(index))
            )
        kind = ("grid", "reference", "load")[min(index, 2)]
        target = 1000.0 * index if kind == "load" else np.nan
        record = StepRecord(
            ProtocolStep(index, kind, target), RigReading(float(index), 1000.0 * index), frames
        )
        recorder.event(float(index), "info", "test", f"step {index}")
        recorder.step(record).result(60)
        # One write of a few bytes: the pipe takes it whole or not at all.
        os.write(1, b"step %d\n" % index)


if __name__ == "__main__":
    serve(record)
