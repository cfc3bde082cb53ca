"""Acquire two cameras of 2048 x 2048 px at 10 images/s and eight channels of 1 kHz; check images and samples.

    python -m benchmarks.acquire --seconds 300 --folder /data
    python -m benchmarks.acquire --seconds 1800 --keep 300

The engine of `rig run` takes the frames of two free-running cameras, whose first pixels contain the number of
the frame, and the samples of a box, whose values contain the number of the sample. Afterwards every image and
every sample in the file is compared with its number, and every image with its digest. The images of 5 minutes
have 25 GB; with `--keep`, only those of the last seconds stay in the file. The exit status is 1 if an image
or a sample is missing, late or wrong, or memory grew.
"""

import argparse
import json
import statistics
import sys
import tempfile
import threading
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from benchmarks.endurance import GROWTH_MAX_MB, resident_mb
from benchmarks.recorder import CAMERAS, START, header, noise
from dic.runfile.digests import frame_digest
from drivers.clock import SystemClock
from drivers.interfaces import CameraInfo, DeviceInfo, Frame, OperatorAction
from drivers.signals import Samples, Signal
from drivers.streams.stream import FrameStream
from rig.devices import Rig
from rig.engine.engine import Engine
from rig.protocol.acquire import AcquireProtocol
from rig.recorder import Recorder
from rig.recorder.header import channel_records

INTERVAL_S = 0.1
RATE_HZ, BLOCK_S = 1000.0, 0.02
SIGNALS = tuple(Signal(f"signal_{number}", "N", -1.0, 1e12) for number in range(8))
EXPOSURE_S, READOUT_S = 0.005, 0.02
IMAGES = 8
MEMORY_S = 1.0
SETTLED_S = 15.0
"""Memory is compared after this time in s, in which queues and caches fill."""


class NumberedCamera:
    """A camera that runs freely from its opening on; its frames are numbered."""

    def __init__(self, name: str, info: CameraInfo, images: list[Any]) -> None:
        self.info = info
        self._name, self._images, self._clock = name, images, SystemClock()
        self._began_s = self._clock.now_s()
        self._next = 0

    def stream(self, capacity: int) -> FrameStream:
        """Return a stream of all frames."""
        self._next = int((self._clock.now_s() - self._began_s) / INTERVAL_S) + 1
        return FrameStream(
            self._name,
            self._source,
            self._clock,
            interval_s=INTERVAL_S,
            silence_s=2.0,
            capacity=capacity,
            on_close=lambda: None,
        )

    def grab(self, timeout_s: float) -> Frame:
        """Return the next frame."""
        frame = self._source(timeout_s)
        assert frame is not None
        return frame

    def close(self) -> None:
        """Do nothing."""

    def _source(self, timeout_s: float) -> Frame | None:
        exposed_s = self._began_s + self._next * INTERVAL_S
        wait_s = exposed_s + EXPOSURE_S + READOUT_S - self._clock.now_s()
        if wait_s > timeout_s:
            self._clock.sleep(timeout_s)
            return None
        self._clock.sleep(wait_s)
        number, self._next = self._next, self._next + 1
        image = self._images[number % len(self._images)].copy()
        image.reshape(-1)[:8].view(np.int64)[0] = number
        image.flags.writeable = False
        now_s, middle_s = self._clock.now_s(), exposed_s + EXPOSURE_S / 2
        return Frame(image, exposed_s, now_s, START, number, 0, 1e6 * EXPOSURE_S, 1.0, middle_s, 1e-4)


class NumberedBox:
    """A box with a clock of its own; the value of a sample is its number."""

    info = DeviceInfo("benchmark", "box", "1", simulated=True)
    signals = SIGNALS
    rate_hz = RATE_HZ

    def __init__(self) -> None:
        self._clock = SystemClock()
        self._began_s = self._clock.now_s()
        self._first = 0

    def read(self, timeout_s: float) -> Samples:
        """Return the samples that came since the last call, all of them."""
        self._clock.sleep(min(timeout_s, BLOCK_S))
        now_s = self._clock.now_s()
        count = max(1, int((now_s - self._began_s) * RATE_HZ) - self._first)
        numbers = np.arange(self._first, self._first + count, dtype=np.float64)
        self._first += count
        values = numbers[:, None] + np.arange(len(SIGNALS)) / 16.0
        return Samples(values, int(numbers[0]), now_s, device_s=numbers / RATE_HZ)

    def close(self) -> None:
        """Do nothing."""


class NobodyAtTheRig:
    """An operator who is not asked in this protocol."""

    def perform(self, action: OperatorAction) -> None:
        """Refuse."""
        raise AssertionError(action)


@dataclass
class MemoryLog(threading.Thread):
    """The memory of this process during the run, once a second."""

    ended: threading.Event = field(default_factory=threading.Event)
    values_mb: list[float] = field(default_factory=list)

    def __post_init__(self) -> None:
        super().__init__(daemon=True)

    __hash__ = threading.Thread.__hash__

    def run(self) -> None:
        while not self.ended.wait(MEMORY_S):
            self.values_mb.append(resident_mb())

    @property
    def growth_mb(self) -> float:
        """The median of the last quarter minus that of the first one, after the beginning."""
        settled = self.values_mb[int(SETTLED_S / MEMORY_S) :] or self.values_mb
        part = max(1, len(settled) // 4)
        return statistics.median(settled[-part:]) - statistics.median(settled[:part])


def acquire(path: Path, seconds: float, keep_s: float | None = None) -> dict[str, Any]:
    """Acquire for some time, check the file, and return the measured values."""
    table: dict[str, Any] = {"every_s": INTERVAL_S} | ({} if keep_s is None else {"keep_s": keep_s})
    protocol = AcquireProtocol.model_validate(
        {
            "kind": "acquire",
            "title": "benchmark",
            "grid_images": "never",
            "reference": False,
            "acquire": table,
            "end": {"duration_s": seconds},
        }
    )
    images, clock = noise(IMAGES), SystemClock()
    cameras = {name: NumberedCamera(name, info, images) for name, info in CAMERAS.items()}
    rig = Rig(clock, NobodyAtTheRig(), dict(cameras), channels={"box": NumberedBox()})
    recorder = Recorder(path, header(), CAMERAS, channels=channel_records(rig))
    memory = MemoryLog()
    memory.start()
    begun_s = clock.now_s()
    outcome = Engine(protocol, rig, recorder).run()
    ended_s = clock.now_s()
    memory.ended.set()
    timing = outcome.timing
    assert timing is not None, outcome.reason
    return {
        "seconds": seconds,
        "keep_s": keep_s,
        "status": outcome.status,
        "reason": outcome.reason,
        **timing.as_dict(),
        "lost_samples": sum(outcome.lost_samples.values()),
        "run_s": round(ended_s - begun_s, 1),
        "memory_mb": [round(min(memory.values_mb), 1), round(max(memory.values_mb), 1)],
        "memory_growth_mb": round(memory.growth_mb, 1),
        "file_gb": round(path.stat().st_size / 1e9, 2),
        **check(path),
    }


def check(path: Path) -> dict[str, Any]:
    """Compare every image and sample of the file with its number, and every image with its digest."""
    damage: list[str] = []
    with h5py.File(path) as file:
        box = file["entry/channels/box"]
        numbers, step = box["number"][()], file["entry/steps"]
        gaps = int((np.diff(numbers) != 1).sum())
        wrong = sum(
            int((box[f"value_{signal.name}"][()] != numbers + k / 16.0).sum())
            for k, signal in enumerate(SIGNALS)
        )
        kept = {}
        for name in CAMERAS:
            group, rows = file[f"entry/instrument/{name}"], step[f"frames_{name}"][()]
            owners, kept[name] = group["step"][()], 0
            sequence = group["sequence"][()]
            for number in np.flatnonzero(owners[rows] == np.arange(len(rows))):
                row = rows[number]
                image = group["data"][row]
                kept[name] += 1
                if group["digest"][row].decode() != frame_digest(image):
                    damage.append(f"{name}: image {row} has a wrong digest")
                if int(image.reshape(-1)[:8].view(np.int64)[0]) != sequence[row]:
                    damage.append(f"{name}: row {row} holds another image than frame {sequence[row]}")
    return {
        "samples": len(numbers),
        "gaps": gaps,
        "wrong_values": wrong,
        "steps": len(rows),
        "images_kept": kept,
        "damage": damage[:10],
    }


def is_good(figures: dict[str, Any]) -> bool:
    """Return True if nothing is lost, late or wrong, and memory stayed constant."""
    expected = round(figures["seconds"] / INTERVAL_S) + 1
    on_file = expected
    if figures["keep_s"] is not None:
        on_file = min(expected, 1 + round(figures["keep_s"] / INTERVAL_S))
    return (
        figures["status"] == "completed"
        and figures["taken"] == figures["steps"] == expected
        and figures["late"] == figures["missing"] == figures["lost_samples"] == 0
        and figures["gaps"] == figures["wrong_values"] == 0
        and figures["samples"] >= RATE_HZ * figures["seconds"]
        # a ring may keep an image more, because it never gives one up early
        and all(on_file <= count <= on_file + 2 for count in figures["images_kept"].values())
        and not figures["damage"]
        and figures["memory_growth_mb"] < GROWTH_MAX_MB
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--folder", type=Path, help="where to write; a temporary folder by default")
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--keep", type=float, help="keep only the images of the last seconds")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=given.folder) as folder:
        figures = acquire(Path(folder) / "run.h5", given.seconds, given.keep)
    print(json.dumps(figures, indent=2))
    sys.exit(not is_good(figures))


if __name__ == "__main__":
    main()
