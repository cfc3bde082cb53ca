import gc
import hashlib
import os
import re
import signal
import stat
import subprocess
import sys
import textwrap
import threading
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from dic.runfile import lock
from drivers.interfaces import CameraInfo, DeviceInfo, Frame
from rig.errors import RecordingError
from rig.protocol.step import ProtocolStep, RigReading
from rig.recorder import Recorder, StepRecord
from rig.recorder.space import CLOSING_BYTES
from rig.recording import RecordingSettings
from tests import run_files
from tests.places import ROOT
from tests.run_files import START

HEADER = replace(run_files.HEADER, definition="µ")
CAMERA = CameraInfo("v", "m", "s", width_px=5, height_px=4, bits=12)


def record(path: Path, camera: CameraInfo = CAMERA, settings: RecordingSettings | None = None) -> Recorder:
    frame = DeviceInfo("v", "m", "s")
    return Recorder(path, HEADER, {"on_axis": camera}, load_frame=frame, settings=settings)


def frame(level: int, shape=(4, 5), dtype=np.uint16) -> Frame:
    return Frame(np.full(shape, level, dtype), 1.5, 1.6, START, level, 0, 900.0, 1.0)


def step(recorder: Recorder, index: int, count: int = 1) -> None:
    rows = [recorder.frame("on_axis", frame(100 * index + i)) for i in range(count)]
    moved = ProtocolStep(index, "load", 2000.0)
    recorder.step(StepRecord(moved, RigReading(2.0, 1999.0), {"on_axis": (rows[0], count)})).result(60.0)


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


def test_file_that_a_killed_program_did_not_complete_is_used_by_the_next(tmp_path):
    path, unfinished = tmp_path / "run.h5", tmp_path / ".run.h5.unfinished"
    unfinished.write_bytes(b"\x89HDF, and no more")
    record(path).close("completed", "", START)
    assert path.exists()
    assert not unfinished.exists()


def test_two_programs_never_create_the_same_file(tmp_path):
    path, unfinished = tmp_path / "run.h5", tmp_path / ".run.h5.unfinished"
    unfinished.write_bytes(b"another program creates it")
    with unfinished.open("r+b") as other:
        lock.hold(other.fileno())
        with pytest.raises(RecordingError, match="never overwritten"):
            record(path)
    assert unfinished.read_bytes() == b"another program creates it"
    assert not path.exists()


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
    for done in (1, 2):
        step(recorder, done)  # waits until it counts
        assert synchronised[-1] == done
    recorder.close("completed", "", START)


def test_folder_is_synchronised_too_so_that_a_power_failure_leaves_the_name(tmp_path, monkeypatch):
    synchronised = []
    monkeypatch.setattr(os, "fsync", lambda descriptor: synchronised.append(os.fstat(descriptor).st_ino))
    recorder = record(tmp_path / "run.h5")
    assert synchronised.count(tmp_path.stat().st_ino) == 1
    recorder.close("completed", "", START)
    assert synchronised.count(tmp_path.stat().st_ino) == 2


def test_images_are_synchronised_by_number_and_by_time(tmp_path, monkeypatch):
    synchronised = []
    settings = RecordingSettings(sync_frames=4, sync_s=3600.0)
    recorder = record(tmp_path / "run.h5", settings=settings)
    monkeypatch.setattr(os, "fsync", synchronised.append)
    for level in range(8):
        # One after the other, so that no batch has more than one image.
        recorder.frame("on_axis", frame(level))
        while not recorder.wait_for_room("on_axis", 20):
            pass
    recorder.close("completed", "", START)
    assert len(synchronised) >= 2


def test_image_is_recorded_as_it_was_when_it_was_handed_over(tmp_path):
    recorder = record(tmp_path / "run.h5")
    shot = frame(7)
    recorder.frame("on_axis", shot)
    shot.image[:] = 0  # a driver that uses its buffer again
    recorder.close("completed", "", START)
    with h5py.File(tmp_path / "run.h5") as file:
        assert (file["entry/instrument/on_axis/data"][0] == 7).all()


def test_closed_file_is_read_only_and_gives_its_space_back(tmp_path):
    path = tmp_path / "run.h5"
    recorder = record(path)
    step(recorder, 0)
    assert path.stat().st_blocks * 512 > CLOSING_BYTES
    recorder.close("completed", "", START)
    assert stat.S_IMODE(path.stat().st_mode) & 0o222 == 0
    assert path.stat().st_blocks * 512 < CLOSING_BYTES


def test_closed_file_carries_the_digest_of_everything_but_the_pixels(tmp_path):
    path = tmp_path / "run.h5"
    recorder = record(path)
    step(recorder, 0, count=3)
    recorder.close("completed", "", START)
    content = bytearray(path.read_bytes())
    with h5py.File(path) as file:
        camera = file["entry/instrument/on_axis"]
        places = [camera["data"].id.get_chunk_info(row) for row in range(3)]
        digests = [hashlib.sha256(image.tobytes()).hexdigest() for image in camera["data"]]
        assert [text.decode() for text in camera["digest"]] == digests
    for place in sorted(places, key=lambda place: place.byte_offset, reverse=True):
        del content[place.byte_offset : place.byte_offset + place.size]
    stated = re.search(rb"\nsha256 ([0-9a-f]{64})\n", content[:4096])
    assert stated[1].decode() == hashlib.sha256(content[4096:]).hexdigest()


def test_no_block_that_is_written_anew_crosses_a_page_of_memory(tmp_path):
    """A program killed within a write leaves its first pages new, and the others old."""
    path = tmp_path / "run.h5"
    recorder = record(path)
    for index in range(300):
        step(recorder, index)
    recorder.close("completed", "", START)
    blocks = []
    with h5py.File(path) as file:

        def note(name, entry):
            if isinstance(entry, h5py.Dataset):
                header = h5py.h5o.get_info(entry.id)
                assert header.hdr.nchunks == 1
                blocks.append((name, file.userblock_size + header.addr, header.hdr.space.total))
            if isinstance(entry, h5py.Dataset) and entry.chunks:
                stored = (entry.id.get_chunk_info(k) for k in range(entry.id.get_num_chunks()))
                blocks.extend((name, chunk.byte_offset, chunk.size) for chunk in stored)

        file.visititems(note)
    assert len(blocks) > 400
    within = [(name, at, size) for name, at, size in blocks if size <= 4096]
    assert [block for block in within if block[1] // 4096 != (block[1] + block[2] - 1) // 4096] == []


def test_disk_slower_than_the_cameras_ends_the_run_and_loses_nothing_recorded(tmp_path, monkeypatch):
    recorder = record(tmp_path / "run.h5", settings=RecordingSettings(queue_frames=2, sync_frames=1))
    stalled, go_on = threading.Event(), threading.Event()
    monkeypatch.setattr(os, "fsync", lambda _: (stalled.set(), go_on.wait(60.0)))
    recorder.frame("on_axis", frame(1))
    assert stalled.wait(60.0)
    recorder.frame("on_axis", frame(2))
    with pytest.raises(RecordingError, match=r"raise recording\.queue_frames in the rig file to 4"):
        recorder.frame("on_axis", frame(3))
    assert not recorder.wait_for_room("on_axis", 0.0)
    go_on.set()
    assert recorder.wait_for_room("on_axis", 20)
    recorder.frame("on_axis", frame(4))
    recorder.close("failed", "too slow", START)
    with h5py.File(tmp_path / "run.h5") as file:
        assert list(file["entry/instrument/on_axis/data"][:, 0, 0]) == [1, 2, 4]


def test_disk_that_does_not_answer_is_one_sentence(tmp_path, monkeypatch):
    recorder = record(tmp_path / "run.h5", settings=RecordingSettings(sync_frames=1, answer_s=1e-3))
    stalled, go_on = threading.Event(), threading.Event()
    monkeypatch.setattr(os, "fsync", lambda _: (stalled.set(), go_on.wait(60.0)))
    recorder.frame("on_axis", frame(1))
    assert stalled.wait(60.0)
    go_on.wait(2e-3)
    with pytest.raises(RecordingError, match=r"no answer of the disk within 0\.001 s; .*recording\.answer_s"):
        recorder.event(0.0, "info", "test", "anything")
    go_on.set()
    recorder.close("failed", "silent", START)


def test_write_that_fails_is_one_sentence_and_the_file_is_released_and_opens(tmp_path):
    """All writes fail from some moment on, as on a broken disk: closing must not crash the program."""
    path = tmp_path / "run.h5"
    recorder = record(path)
    step(recorder, 0)
    broken = os.open("/dev/full", os.O_RDWR)
    os.dup2(broken, recorder._file._hdf5.id.get_vfd_handle())
    os.close(broken)
    record_of_step = StepRecord(ProtocolStep(1, "load", 2000.0), RigReading(2.0, 1999.0), {})
    recorder.frame("on_axis", frame(1))
    with pytest.raises(RecordingError, match="recording"):
        recorder.step(record_of_step).result(60.0)
    with pytest.raises(RecordingError, match="recording"):
        recorder.event(0.0, "info", "test", "anything")
    recorder.close("failed", "broken", START)
    recorder.close("failed", "broken", START)
    gc.collect()
    with h5py.File(path) as file:
        assert list(file["entry/instrument/on_axis/data"][:1, 0, 0]) == [0]
        assert list(file["entry/steps/complete"]) == [1]


KILLED = """
import os, signal, sys
sys.path.insert(0, {folder!r})
from pathlib import Path
from tests.rig.recorder import test_recorder as t
recorder = t.record(Path({path!r}))
for index in range({steps}):
    t.step(recorder, index, count=2)
    recorder.event(0.0, "info", "test", "step")
recorder.frame("on_axis", t.frame(4000))
recorder.synchronise().result(60.0)
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
from tests.rig.recorder import test_recorder as t
from drivers.interfaces import CameraInfo
from rig.errors import RecordingError
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
camera = CameraInfo("v", "m", "s", width_px=200, height_px=100, bits=8)
recorder = t.record(Path({path!r}), camera)
resource.setrlimit(resource.RLIMIT_FSIZE, (2_000_000, 2_000_000))
try:
    for index in range(100):
        assert recorder.wait_for_room("on_axis", 20)
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
    assert child.returncode == 0
    with h5py.File(path) as file:
        camera = file["entry/instrument/on_axis"]
        n = len(camera["valid"])
        assert 10 <= n < 100
        assert list(camera["data"][:n, 0, 0]) == list(range(n))
        assert file["entry/status"][()] == b"failed"
        assert file["entry/status_reason"][()] == b"disk full"
