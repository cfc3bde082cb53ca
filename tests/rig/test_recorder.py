import os
import signal
import subprocess
import sys
import textwrap
from datetime import UTC, datetime
from pathlib import Path

import h5py
import numpy as np
import pytest

from drivers.interfaces import CameraInfo, DeviceInfo, Frame
from rig.errors import RecordingError
from rig.protocol.protocol import Grid, Sample
from rig.protocol.step import ProtocolStep, Reading
from rig.recorder import Recorder, RunHeader, StepRecord
from tests.places import ROOT

START = datetime(2026, 3, 4, 5, 6, 7, 89000, tzinfo=UTC)
HEADER = RunHeader(
    title="Rotation at 30°",
    run_id="r1",
    definition="µ",
    configuration="",
    start=START,
    versions="python 3",
    sample=Sample(name="sheet", thickness_mm=1.0, width_mm=25.0, gauge_length_mm=60.0),
    grid=Grid(),
    simulated=True,
)
CAMERA = CameraInfo("v", "m", "s", width_px=5, height_px=4, bits=12)


def record(path: Path, camera: CameraInfo = CAMERA) -> Recorder:
    return Recorder(path, HEADER, {"on_axis": camera}, load_frame=DeviceInfo("v", "m", "s"))


def frame(level: int, shape=(4, 5), dtype=np.uint16) -> Frame:
    return Frame(np.full(shape, level, dtype), 1.5, 1.6, START, level, 0, 900.0, 1.0)


def step(recorder: Recorder, index: int, count: int = 1) -> None:
    rows = [recorder.frame("on_axis", frame(100 * index + i)) for i in range(count)]
    recorder.step(
        StepRecord(ProtocolStep(index, "load", 2000.0), Reading(2.0, 1999.0), {"on_axis": (rows[0], count)})
    )


def test_what_was_recorded_stands_in_the_file(tmp_path):
    recorder = record(tmp_path / "run.h5")
    step(recorder, 0)
    step(recorder, 1, count=2)
    recorder.event(3.0, "warning", "engine", "a" * 239 + "µ")
    recorder.close("completed", "", START)

    with h5py.File(tmp_path / "run.h5") as file:
        entry = file["entry"]
        assert entry["title"][()].decode() == "Rotation at 30°"
        assert entry["start_time"][()].decode() == "2026-03-04T05:06:07.089000+00:00"
        assert entry["status"][()] == b"completed"
        camera = entry["instrument/on_axis"]
        assert list(camera["data"][:, 0, 0]) == [0, 100, 101]
        assert list(camera["step"]) == [0, 1, 1]
        assert list(camera["valid"]) == [1, 1, 1]
        # 2026-03-04T05:06:07.089 is 1772600767.089 s after 1970 (by GNU date).
        assert list(camera["utc_ns"]) == [1772600767_089_000_000] * 3
        assert list(entry["steps/frames_on_axis"]) == [0, 1]
        assert list(entry["steps/count_on_axis"]) == [1, 2]
        assert np.isnan(entry["steps/angle_deg"]).all()
        # The 240th byte would be half a character.
        assert entry["events/message"][0].decode() == "a" * 239


def test_existing_file_is_never_overwritten(tmp_path):
    path = tmp_path / "run.h5"
    path.write_bytes(b"precious")
    with pytest.raises(RecordingError, match="never overwritten"):
        record(path)
    assert path.read_bytes() == b"precious"


def test_missing_folder_is_one_sentence(tmp_path):
    with pytest.raises(RecordingError, match="expected creating the run file to succeed"):
        record(tmp_path / "nowhere" / "run.h5")


def test_reader_sees_finished_steps_while_the_run_goes_on(tmp_path):
    recorder = record(tmp_path / "run.h5")
    step(recorder, 0)
    with h5py.File(tmp_path / "run.h5", "r", swmr=True) as file:
        assert list(file["entry/steps/complete"]) == [1]
        step(recorder, 1)
        file["entry/steps/complete"].refresh()
        assert list(file["entry/steps/complete"]) == [1, 1]
    recorder.close("completed", "", START)


def test_every_finished_step_is_on_the_disk_before_it_counts(tmp_path, monkeypatch):
    recorder = record(tmp_path / "run.h5")
    synchronised = []

    def look(descriptor):
        with h5py.File(tmp_path / "run.h5", "r", swmr=True) as file:
            synchronised.append(len(file["entry/steps/complete"]))

    monkeypatch.setattr(os, "fsync", look)
    step(recorder, 0)
    step(recorder, 1)
    recorder.close("completed", "", START)
    assert synchronised == [1, 2, 2]


KILLED = """
import os, signal, sys
sys.path.insert(0, {folder!r})
from pathlib import Path
from tests.rig import test_recorder as t
recorder = t.record(Path({path!r}))
for index in range({steps}):
    t.step(recorder, index, count=2)
    recorder.event(0.0, "info", "test", "step")
recorder.frame("on_axis", t.frame(4000))
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_killed_run_opens_with_every_finished_step(tmp_path):
    path = tmp_path / "run.h5"
    script = textwrap.dedent(KILLED.format(folder=str(ROOT), path=str(path), steps=7))
    killed = subprocess.run([sys.executable, "-c", script], check=False, timeout=60)
    assert killed.returncode == -signal.SIGKILL

    with h5py.File(path, "r", swmr=True) as file:
        entry = file["entry"]
        assert entry["status"][()] == b"running"
        assert list(entry["steps/index"]) == list(range(7))
        assert list(entry["steps/complete"]) == [1] * 7
        camera = entry["instrument/on_axis"]
        for row, (first, count) in enumerate(
            zip(entry["steps/frames_on_axis"][()], entry["steps/count_on_axis"][()], strict=True)
        ):
            assert list(camera["valid"][first : first + count]) == [1, 1]
            assert list(camera["data"][first : first + count, 3, 4]) == [100 * row, 100 * row + 1]
        # The image of the unfinished step is there as well: it was acknowledged.
        assert camera["valid"][14] == 1


FULL = """
import resource, signal, sys
sys.path.insert(0, {folder!r})
from datetime import UTC, datetime
from pathlib import Path
from tests.rig import test_recorder as t
from drivers.interfaces import CameraInfo
from rig.errors import RecordingError
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
camera = CameraInfo("v", "m", "s", width_px=200, height_px=100, bits=8)
recorder = t.record(Path({path!r}), camera)
resource.setrlimit(resource.RLIMIT_FSIZE, (300_000, 300_000))
try:
    for index in range(100):
        recorder.frame("on_axis", t.frame(index, (100, 200), "u1"))
except RecordingError as error:
    print(index, error)
try:
    recorder.close("failed", "disk full", t.START)
except RecordingError as error:
    print("closing", error)
"""


def test_full_disk_is_one_sentence_and_the_images_before_are_readable(tmp_path):
    path = tmp_path / "run.h5"
    script = textwrap.dedent(FULL.format(folder=str(ROOT), path=str(path)))
    child = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=60, check=False
    )
    assert "Traceback" not in child.stderr
    assert "expected recording an image of on_axis to succeed" in child.stdout
    assert "check free space" in child.stdout
    failed_at = int(child.stdout.split()[0])
    with h5py.File(path, "r", swmr=True) as file:
        camera = file["entry/instrument/on_axis"]
        assert failed_at >= 10
        assert list(camera["data"][:failed_at, 0, 0]) == list(range(failed_at))
