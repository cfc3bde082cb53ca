"""An acquisition without end in real time, which `test_killed_acquisitions` starts and kills.

Two cameras film 50 small frames per second, each of which shows its number; a box takes 1000 samples per
second, whose values are their numbers. For each step that is on the disk, the program writes a line into a
file beside the run file: the step, the number of its frame of each camera, the middle of its exposure, and
the number of the last sample that was recorded before it. If "ring" is in the name of the run file, only the
images of the last second stay.
"""

import os
import tomllib
from dataclasses import replace
from pathlib import Path
from threading import Lock

import numpy as np

from drivers.clock import SystemClock
from drivers.errors import DeviceTimeout
from drivers.interfaces import CameraInfo, Frame
from drivers.signals import Samples, Signal
from rig.protocol.acquire import AcquireProtocol
from tests.rig.channels.fake_box import BOX
from tests.rig.conftest import CAMERA, FakeRig
from tests.rig.recorder.forked_runs import serve

KEEP_S = 1.0
PERIOD_S, BLOCK_S, RATE_HZ = 0.02, 0.01, 1000.0
SHAPE = (12, 16)
PROTOCOL = """
kind = "acquire"
title = "to be killed"
grid_images = "never"
reference = false
[acquire]
every_frame = true
KEEP
[end]
on_request = true
"""


def told_path(path: Path) -> Path:
    """Return the path of the file with the acknowledged steps of a run."""
    return path.with_suffix(".told")


def picture(number: int) -> np.ndarray:
    """Return the image that shows a number in its first row, one digit of base 256 in each pixel."""
    image = np.full(SHAPE, number % 251, np.uint8)
    image[0, :4] = np.frombuffer(number.to_bytes(4, "big"), np.uint8)
    return image


def number_in(image: np.ndarray) -> int:
    """Return the number that an image shows. Raise `AssertionError` if it is not the whole image of it."""
    number = int.from_bytes(image[0, :4].tobytes(), "big")
    np.testing.assert_array_equal(image, picture(number))
    return number


class NumberedCamera:
    """A camera with a stream whose frames show their numbers."""

    interval_s = shortest_s = PERIOD_S

    def __init__(self, clock: SystemClock) -> None:
        self.clock = clock
        self.info: CameraInfo = replace(CAMERA, width_px=SHAPE[1], height_px=SHAPE[0])
        self._number = 0

    def stream(self, capacity: int) -> "NumberedCamera":
        self._number = int(self.clock.now_s() / PERIOD_S) + 1
        return self

    def next(self, timeout_s: float) -> Frame:
        number, self._number = self._number, self._number + 1
        begin_s = number * PERIOD_S
        if (wait_s := begin_s + 0.004 - self.clock.now_s()) > timeout_s:
            raise DeviceTimeout("cameras", "stream", "a frame", "none", "wait")
        self.clock.sleep(max(0.0, wait_s))
        now_s = max(self.clock.now_s(), begin_s + 0.004)
        return Frame(
            picture(number), begin_s, now_s, self.clock.utc(), number, 0, 2e3, 1.0, begin_s + 0.001, 1e-4
        )

    def report(self) -> "NumberedCamera":
        return self

    @property
    def losses(self) -> tuple[()]:
        return ()

    def close(self) -> None:
        """Nothing is to be closed."""


class NumberedBox:
    """A box whose samples have their numbers as values, in blocks with times of its own clock."""

    signals = (Signal("number", "1", -1.0, 1e9), Signal("twice", "1", -1.0, 1e9))
    rate_hz, info = RATE_HZ, BOX

    def __init__(self, clock: SystemClock) -> None:
        self.clock, self._count, self._begun_s = clock, 0, clock.now_s()

    def read(self, timeout_s: float) -> Samples:
        self.clock.sleep(BLOCK_S)
        due = max(self._count + 1, int((self.clock.now_s() - self._begun_s) * RATE_HZ))
        numbers = np.arange(self._count, due, dtype=np.float64)
        self._count = due
        values = np.stack([numbers, 2.0 * numbers], axis=1)
        return Samples(values, int(numbers[0]), self.clock.now_s(), device_s=numbers / RATE_HZ)

    def close(self) -> None:
        """Nothing is to be closed."""


def record(path: Path) -> None:
    """Execute the acquisition, until somebody kills it."""
    keep = f"keep_s = {KEEP_S}" if "ring" in path.stem else ""
    text = PROTOCOL.replace("KEEP", keep)
    clock = SystemClock()
    rig = FakeRig(AcquireProtocol.model_validate(tomllib.loads(text)), path, definition=text, clock=clock)
    rig.cameras = {name: NumberedCamera(clock) for name in rig.cameras}
    rig.channels = {"box": NumberedBox(clock)}
    told = os.open(told_path(path), os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    lock, last_sample = Lock(), -1
    waiting: dict[int, int] = {}

    def on_step(record):
        with lock:
            last = waiting.pop(record.step.index)
        middle_s = record.reading.time_s
        # One write of a few bytes: the file has it whole or not at all.
        os.write(told, b"%d %.6f %d\n" % (record.step.index, middle_s, last))
        os.write(1, b"step %d\n" % record.step.index)

    engine = rig.engine(on_step=[on_step])
    recorder = engine.context.recorder
    samples, step = recorder.samples, recorder.step

    def counted_samples(name, timed):
        nonlocal last_sample
        samples(name, timed)
        with lock:
            last_sample = timed.first + len(timed.values) - 1

    def counted_step(record):
        with lock:
            waiting[record.step.index] = last_sample
        return step(record)

    recorder.samples, recorder.step = counted_samples, counted_step
    engine.run()


if __name__ == "__main__":
    serve(record)
