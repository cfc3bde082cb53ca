"""Record two cameras of 2048 x 2048 px at 5 images/s for 30 minutes; check images and memory.

    python -m benchmarks.endurance --minutes 30 --folder /data

Each camera has a thread that gives the recorder a frame every 200 ms; the first pixels contain the number of
the frame. Another process reads the run file while it is written, and compares every image with its digest
and its number. With `--recycle`, this process frees the disk space of each image after the check, because the
images of 30 minutes have 75 GB. The exit status is 1 if an image was lost or memory grew.
"""

import argparse
import ctypes
import json
import multiprocessing
import os
import statistics
import sys
import tempfile
import threading
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from benchmarks.recorder import CAMERAS, START, header, noise
from dic.runfile.digests import frame_digest
from drivers.clock import SystemClock
from drivers.interfaces import DeviceInfo, Frame, LoadFrameState
from rig.protocol.step import ProtocolStep, RigReading
from rig.recorder import Recorder, StepRecord

PERIOD_S = 0.2
STEP_S = 10.0
GROWTH_MAX_MB = 64.0
_PUNCH_HOLE_KEEP_SIZE = 3


@dataclass
class Source(threading.Thread):
    """The thread of a camera: it gives the recorder a numbered image every `PERIOD_S` seconds."""

    camera: str
    recorder: Recorder
    images: list[np.ndarray]
    count: int
    began_s: float
    slowest_ms: float = 0.0
    latest_ms: float = 0.0
    taken: int = 0
    failure: str = ""

    def __post_init__(self) -> None:
        super().__init__(daemon=True)

    __hash__ = threading.Thread.__hash__

    def run(self) -> None:
        clock = SystemClock()
        try:
            for number in range(self.count):
                due_s = self.began_s + number * PERIOD_S
                clock.sleep(due_s - clock.now_s())
                image = self.images[number % len(self.images)].copy()
                image.reshape(-1)[:8].view(np.int64)[0] = number
                image.flags.writeable = False
                now_s = clock.now_s()
                self.latest_ms = max(self.latest_ms, 1e3 * (now_s - due_s))
                self.recorder.frame(self.camera, Frame(image, due_s, now_s, START, number, 0, 900.0, 1.0))
                self.slowest_ms = max(self.slowest_ms, 1e3 * (clock.now_s() - now_s))
                self.taken += 1
        except Exception as error:
            self.failure = f"{type(error).__name__}: {error}"


@dataclass
class Followed:
    """Result of the process that reads the file: checked rows by camera, and sentences about damage."""

    rows: dict[str, int] = field(default_factory=lambda: dict.fromkeys(CAMERAS, 0))
    damage: list[str] = field(default_factory=list)


def follow(path: str, recycle: bool, ended: Any, answer: Any) -> None:
    """Check every image soon after it is marked valid, until `ended` is set and all images are checked."""
    found, clock = Followed(), SystemClock()
    descriptor = os.open(path, os.O_RDWR)
    with h5py.File(path, "r", swmr=True) as file:
        last = False
        while True:
            busy = False
            for name in CAMERAS:
                group = file[f"entry/instrument/{name}"]
                for column in ("valid", "digest", "sequence", "data"):
                    group[column].refresh()
                while found.rows[name] < len(group["valid"]) and group["valid"][found.rows[name]]:
                    check_row(group, found.rows[name], found)
                    if recycle:
                        punch(descriptor, group["data"], found.rows[name])
                    found.rows[name] += 1
                    busy = True
            if last and not busy:
                break
            last = ended.is_set()
            clock.sleep(0.0 if busy else 0.1)
    os.close(descriptor)
    answer.send(found)


def check_row(group: h5py.Group, row: int, found: Followed) -> None:
    """Compare an image with its digest, and its number with its row; add each difference to `found`."""
    image = group["data"][row]
    number = int(image.reshape(-1)[:8].view(np.int64)[0])
    if group["digest"][row].decode() != frame_digest(image):
        found.damage.append(f"{group.name}: image {row} has a wrong digest")
    if not number == row == group["sequence"][row]:
        found.damage.append(f"{group.name}: row {row} holds image {number}")


def punch(descriptor: int, data: h5py.Dataset, row: int) -> None:
    """Free the disk space of an image, but keep the size of the file."""
    chunk = data.id.get_chunk_info_by_coord((row, 0, 0))
    size = ctypes.c_int64
    libc = ctypes.CDLL(None, use_errno=True)
    # Do not free the first and the last disk block if they also contain other data.
    first, end = -(-chunk.byte_offset // 4096) * 4096, (chunk.byte_offset + chunk.size) // 4096 * 4096
    libc.fallocate(descriptor, _PUNCH_HOLE_KEEP_SIZE, size(first), size(end - first))


def resident_mb() -> float:
    """Return the resident memory of this process, MB."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def endure(path: Path, minutes: float, recycle: bool) -> dict[str, Any]:
    """Record for the given number of minutes, and return the measured values."""
    clock, images = SystemClock(), noise(8)
    recorder = Recorder(path, header(), CAMERAS, load_frame=DeviceInfo("benchmark", "frame", "1"))
    processes = multiprocessing.get_context("spawn")
    ended, (ear, mouth) = processes.Event(), processes.Pipe(duplex=False)
    follower = processes.Process(target=follow, args=(str(path), recycle, ended, mouth))
    follower.start()
    count = int(minutes * 60 / PERIOD_S)
    began_s = clock.now_s() + 2.0
    sources = [Source(name, recorder, images, count, began_s) for name in CAMERAS]
    for source in sources:
        source.start()
    memory_mb: list[float] = []
    steps, slowest_step_s, tick = 0, 0.0, 0
    filed = dict.fromkeys(CAMERAS, 0)
    while any(source.is_alive() for source in sources):
        clock.sleep(began_s + tick * 0.1 - clock.now_s())
        tick += 1
        recorder.load_frame_state(
            LoadFrameState(float(tick), 0.0, False, True, True, tick, (), clock.now_s())
        )
        if tick % int(STEP_S / 0.1) == 0:
            rows = {source.camera: source.taken for source in sources}
            taken = {name: (filed[name], rows[name] - filed[name]) for name in CAMERAS}
            filed = rows
            asked_s = clock.now_s()
            step = ProtocolStep(steps, "load", float(steps))
            recorder.step(StepRecord(step, RigReading(asked_s, float(steps)), taken)).result(60)
            slowest_step_s = max(slowest_step_s, clock.now_s() - asked_s)
            steps += 1
            memory_mb.append(resident_mb())
            if steps % 30 == 0:
                print(f"{steps * STEP_S / 60:.0f} min, {memory_mb[-1]:.0f} MB", flush=True)
    recorder.synchronise().result(60)
    ended.set()
    followed = ear.recv() if ear.poll(120.0) else Followed()
    follower.join(10.0)
    asked_s = clock.now_s()
    recorder.close("completed", "", START)
    # Leave out the first minute, in which queues and caches fill. Compare medians, because a busy disk fills
    # the queues for a short time.
    settled = memory_mb[6:] or memory_mb or [resident_mb()]
    part = max(1, len(settled) // 4)
    early_mb, late_mb = statistics.median(settled[:part]), statistics.median(settled[-part:])
    return {
        "minutes": minutes,
        "images_taken": {source.camera: source.taken for source in sources},
        "images_checked": followed.rows,
        "damage": followed.damage[:10],
        "failures": [source.failure for source in sources if source.failure],
        "steps": steps,
        "readings": tick,
        "memory_mb": [round(min(settled), 1), round(max(settled), 1)],
        "memory_growth_mb": round(late_mb - early_mb, 1),
        "slowest_handover_ms": round(max(source.slowest_ms for source in sources), 1),
        "latest_frame_ms": round(max(source.latest_ms for source in sources), 1),
        "slowest_step_s": round(slowest_step_s, 3),
        "closing_s": round(clock.now_s() - asked_s, 3),
        "file_gb": round(path.stat().st_size / 1e9, 2),
    }


def is_good(figures: dict[str, Any]) -> bool:
    """Return True if every image was recorded and read back, and memory stayed constant."""
    expected = dict.fromkeys(CAMERAS, int(figures["minutes"] * 60 / PERIOD_S))
    return (
        figures["images_taken"] == figures["images_checked"] == expected
        and not figures["damage"]
        and not figures["failures"]
        and figures["memory_growth_mb"] < GROWTH_MAX_MB
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--folder", type=Path, help="where to write; a temporary folder by default")
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--recycle", action="store_true", help="give the space of checked images back")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=given.folder) as folder:
        figures = endure(Path(folder) / "run.h5", given.minutes, given.recycle)
    print(json.dumps(figures, indent=2))
    sys.exit(not is_good(figures))


if __name__ == "__main__":
    main()
