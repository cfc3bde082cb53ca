"""If the disk is full or a file too large, the run ends with a one-sentence error and a closed file."""

import random
import subprocess
from collections.abc import Iterator
from contextlib import nullcontext, suppress
from dataclasses import replace
from functools import cache
from pathlib import Path

import h5py
import numpy as np
import pytest

from drivers.interfaces import CameraInfo
from rig.commands.verify import verify_run
from rig.errors import RecordingError
from rig.protocol.step import ProtocolStep, RigReading
from rig.recorder import Recorder, StepRecord
from rig.recorder.file import OpenRunFile
from rig.recorder.space import CLOSING_BYTES
from tests.full_disk import full_disk
from tests.run_files import HEADER, START, take

STEPS = 5
WIDE = "wide"
CAMERAS = {
    name: CameraInfo("v", "m", "s", width_px=width_px, height_px=height_px, bits=8)
    for name, width_px, height_px in ((WIDE, 1280, 1280), ("left", 128, 56), ("right", 128, 56))
}
"""The cameras of the tests.

The wide camera takes one image, which is larger than the space that the recorder reserves when it creates the
file. So the last 64 kB of the file belong to the other images, and not to the reserved space.
"""
PAGE_BYTES = 4096
VOLUME_BYTES = 4 << 20
LAST_BYTES = 64 << 10
PART_BYTES = 1024


frame_of = cache(take)


def record(path: Path) -> tuple[int, str]:
    """Record a run to its end or to the first error; return the acknowledged steps and the error."""
    try:
        recorder = Recorder(path, HEADER, CAMERAS)
    except RecordingError as error:
        return 0, str(error)
    steps, reason = 0, ""
    try:
        for index in range(STEPS):
            frames = {
                name: (0 if name == WIDE and index else recorder.frame(name, frame_of(info, index)), 1)
                for name, info in CAMERAS.items()
            }
            kind = ("grid", "reference", "load")[min(index, 2)]
            step = StepRecord(ProtocolStep(index, kind), RigReading(float(index), 1.0), frames)
            recorder.step(step).result(60)
            steps += 1
    except RecordingError as error:
        reason = str(error)
    # the failure that the future of a step has told is raised once more
    with suppress(RecordingError) if reason else nullcontext():
        recorder.close("failed" if reason else "completed", reason, START)
    return steps, reason


def check_recording(path: Path, steps: int, reason: str) -> None:
    """Check that the error is one sentence, and that the closed file has all acknowledged data."""
    assert "\n" not in reason
    assert bool(reason) == (steps < STEPS)
    assert reason == "" or "check free space" in reason
    if not path.exists():
        assert steps == 0
        return
    with h5py.File(path) as file:
        entry = file["entry"]
        assert entry["status"][()] == (b"failed" if reason else b"completed")
        assert entry["status_reason"][()].decode() == reason
        assert list(entry["steps/complete"]) == [1] * steps
        for name, info in CAMERAS.items():
            images = entry[f"instrument/{name}/data"][:]
            for index in range(min(steps, 1) if name == WIDE else steps):
                np.testing.assert_array_equal(images[index], frame_of(info, index).image)


def check_digest(path: Path) -> None:
    assert not path.exists() or verify_run(path).digest == "right"


def check_limit(path: Path, size: int) -> int | None:
    """Record with a limited file size, and check the file; return the number of acknowledged steps.

    The result is None if the limit was too small to create the file.
    """
    path.unlink(missing_ok=True)
    with full_disk(size):
        steps, reason = record(path)
    check_recording(path, steps, reason)
    if size % 64 == 0:
        check_digest(path)
    return steps if path.exists() else None


@pytest.fixture(scope="module")
def enough(tmp_path_factory) -> int:
    """The smallest limit of the file size, in bytes, with which the run is completed."""
    folder = tmp_path_factory.mktemp("enough")
    low, high = CLOSING_BYTES, 4 * CLOSING_BYTES
    while low < high:
        middle = (low + high) // 2
        with full_disk(middle):
            _, reason = record(folder / f"{middle}.h5")
        low, high = (middle + 1, high) if reason else (low, middle)
    return low


@pytest.mark.extended
def test_limit_on_the_size_of_files_is_one_sentence_wherever_it_is(enough, tmp_path):
    rng = random.Random(1)
    assert check_limit(tmp_path / "run.h5", enough) == STEPS
    assert check_limit(tmp_path / "run.h5", enough - 1) == STEPS - 1
    assert check_limit(tmp_path / "run.h5", enough - LAST_BYTES) in (0, 1)
    for _ in range(12):
        assert check_limit(tmp_path / "run.h5", enough - rng.randrange(LAST_BYTES)) is not None
    for _ in range(8):
        check_limit(tmp_path / "run.h5", rng.randrange(enough))


@pytest.mark.long
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("part", range(LAST_BYTES // PART_BYTES))
def test_limit_at_every_byte_of_the_last_64_kb(enough, tmp_path, part):
    first = enough - LAST_BYTES + part * PART_BYTES
    steps = [check_limit(tmp_path / "run.h5", size) for size in range(first, first + PART_BYTES)]
    # a byte more never loses a step
    assert steps == sorted(steps)
    assert set(steps) <= set(range(STEPS))


@pytest.mark.long
@pytest.mark.timeout(3600)
def test_limit_at_a_hundred_random_places(enough, tmp_path):
    rng = random.Random(2)
    for _ in range(100):
        check_limit(tmp_path / "run.h5", rng.randrange(enough))


def test_file_whose_writes_failed_is_left_as_it_is(tmp_path):
    """Here a write fails and not the reservation, as on a broken disk."""
    path = tmp_path / "run.h5"
    file = OpenRunFile(path, HEADER, CAMERAS, {})
    with full_disk(path.stat().st_size):
        with pytest.raises(OSError, match="too large"):
            file.add_frame("left", 0, frame_of(CAMERAS["left"], 0), 0, "0" * 64, 0)
        file.abandon()
    file.close("failed", "a broken disk", START)
    with h5py.File(path) as left:
        assert left["entry/status"][()] == b"running"


@pytest.fixture(scope="module")
def volume(tmp_path_factory) -> Iterator[Path]:
    """The path of a mounted volume of 4 MiB."""
    folder = tmp_path_factory.mktemp("volume")
    command = ["mount", "-t", "tmpfs", "-o", f"size={VOLUME_BYTES}", "tmpfs", str(folder)]
    try:
        mounted = subprocess.run(command, capture_output=True, text=True, check=False)
    except OSError as error:
        pytest.skip(f"no volume can be mounted: {error}")
    if mounted.returncode:
        pytest.skip(f"no volume can be mounted: {mounted.stderr.strip()}")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


def check_free_space(volume: Path, pages: int) -> None:
    for path in volume.iterdir():
        path.unlink()
    (volume / "filler").write_bytes(bytes(VOLUME_BYTES - pages * PAGE_BYTES))
    path = volume / "run.h5"
    steps, reason = record(path)
    check_recording(path, steps, reason)
    check_digest(path)


@pytest.fixture(scope="module")
def enough_pages(volume) -> int:
    """The smallest number of free memory pages of the volume with which the run is completed."""
    low, high = 1, VOLUME_BYTES // PAGE_BYTES
    while low < high:
        middle = (low + high) // 2
        for path in volume.iterdir():
            path.unlink()
        (volume / "filler").write_bytes(bytes(VOLUME_BYTES - middle * PAGE_BYTES))
        _, reason = record(volume / "run.h5")
        low, high = (middle + 1, high) if reason else (low, middle)
    return low


def test_full_disk_is_one_sentence_wherever_it_is(volume, enough_pages):
    rng = random.Random(3)
    for pages in [
        *range(enough_pages - 4, enough_pages + 1),
        *(rng.randrange(enough_pages) for _ in range(8)),
    ]:
        check_free_space(volume, pages)


@pytest.mark.long
@pytest.mark.timeout(3600)
def test_full_disk_at_every_page_of_the_last_64_kb_and_anywhere(volume, enough_pages):
    rng = random.Random(4)
    last = range(enough_pages - LAST_BYTES // PAGE_BYTES, enough_pages + 1)
    for pages in [*last, *(rng.randrange(enough_pages) for _ in range(100))]:
        check_free_space(volume, pages)


def test_disk_that_becomes_full_during_a_run_ends_it_safely(volume, rotation):
    for path in volume.iterdir():
        path.unlink()
    rotation.path = volume / "run.h5"
    image = np.zeros((300, 400), np.uint8)  # 36 of them take more than the volume has
    for camera in rotation.cameras.values():
        camera.info = replace(camera.info, width_px=400, height_px=300)
        camera.on_grab = lambda _, frame: replace(frame, image=image)
    outcome = rotation.engine().run()
    assert 3 < outcome.steps_done < 17
    assert (outcome.status, outcome.recorded, outcome.lost_listeners) == ("failed", False, ())
    assert "No space left on device; check free space" in outcome.reason
    assert "\n" not in outcome.reason
    assert rotation.calls[-1] == "stop"
    found = verify_run(rotation.path)
    assert (found.status, found.steps, found.digest) == ("failed", outcome.steps_done, "right")
    assert found.reason == outcome.reason
