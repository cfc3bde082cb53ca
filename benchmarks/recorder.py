"""Compare the speed of the recorder with plain writing of the same images to a file.

    python -m benchmarks.recorder --folder /data

Plain writing calls `os.pwrite` for every image, and `os.fsync` after the same number of images as the
recorder. The recorder also computes a SHA-256 of every image, and writes its tables. Both take turns. A ratio
of 1 means that the recorder is as fast as plain writing. Then both write one image of each camera after a
pause, as in a step of a run, and the time until these images are on the disk is compared. The exit status is
1 if the median ratio of the speeds is below 0.8, or the median times of a step have a ratio above 1.5.
"""

import argparse
import os
import statistics
import sys
import tempfile
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from drivers.clock import SystemClock
from drivers.interfaces import CameraInfo, Frame
from rig.protocol.grid import Grid
from rig.protocol.tables import Sample
from rig.recorder import Recorder, RunHeader
from rig.recording import RecordingSettings

SIDE_PX = 2048
LEAST_RATIO = 0.8
MOST_WAIT = 1.5
PAUSE_S = 1.1  # longer than `sync_s`, after which the recorder synchronises what it has written
START = datetime(2026, 1, 1, tzinfo=UTC)
CAMERAS = {
    name: CameraInfo("benchmark", "noise", name, width_px=SIDE_PX, height_px=SIDE_PX)
    for name in ("left", "right")
}


def header() -> RunHeader:
    """Return the header of a run that has no protocol and no rig file."""
    sample = Sample(name="noise", thickness_mm=1.0, width_mm=10.0, gauge_length_mm=50.0)
    return RunHeader("benchmark", "", "", "", START, "", sample, Grid(), simulated=True)


def noise(count: int) -> list[np.ndarray]:
    """Return read-only images of random noise, which no file system can compress."""
    random = np.random.default_rng(1)
    images = [random.integers(0, 256, (SIDE_PX, SIDE_PX), np.uint8) for _ in range(count)]
    for image in images:
        image.flags.writeable = False
    return images


def frames(images: list[np.ndarray], count: int) -> Iterator[tuple[str, Frame]]:
    """Yield `count` frames with the names of their cameras; the two cameras alternate."""
    for number in range(count):
        image = images[number % len(images)]
        yield list(CAMERAS)[number % 2], Frame(image, 0.0, 0.0, START, number // 2, 0, 900.0, 1.0)


def plainly(path: Path, images: list[np.ndarray], count: int, settings: RecordingSettings) -> float:
    """Write all images plainly, and return the time in seconds until they are on the disk."""
    clock = SystemClock()
    descriptor = os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY)
    began_s = clock.now_s()
    for number, (_, frame) in enumerate(frames(images, count), 1):
        os.pwrite(descriptor, frame.image.data, (number - 1) * frame.image.nbytes)
        if number % settings.sync_frames == 0:
            os.fsync(descriptor)
    os.fsync(descriptor)
    took_s = clock.now_s() - began_s
    os.close(descriptor)
    path.unlink()
    return took_s


def recorded(path: Path, images: list[np.ndarray], count: int, settings: RecordingSettings) -> float:
    """Record all images, and return the time in seconds until they are on the disk."""
    clock = SystemClock()
    recorder = Recorder(path, header(), CAMERAS, settings=settings)
    began_s = clock.now_s()
    for camera, frame in frames(images, count):
        while not recorder.wait_for_room(camera, 60.0):
            pass
        recorder.frame(camera, frame)
    recorder.synchronise().result(600)
    took_s = clock.now_s() - began_s
    recorder.close("completed", "", START)
    path.unlink()
    return took_s


def compare(folder: Path, rounds: int, count: int) -> float:
    """Print the speeds of recorder and plain writing in every round, and return the median speed ratio."""
    images, settings = noise(8), RecordingSettings()
    size_mb = count * images[0].nbytes / 1e6
    ratios = []
    for number in range(rounds):
        measured = {}
        # The disk may still be busy for the second of the two. So each of them is the first in every other
        # round.
        for run in (plainly, recorded) if number % 2 == 0 else (recorded, plainly):
            measured[run.__name__] = run(folder / f"{run.__name__}.h5", images, count, settings)
        ratios.append(measured["plainly"] / measured["recorded"])
        speeds = ", ".join(f"{name} {size_mb / s:.0f} MB/s" for name, s in sorted(measured.items()))
        print(f"round {number + 1}: {speeds}, ratio {ratios[-1]:.2f}", flush=True)
    median = statistics.median(ratios)
    print(
        f"median ratio of {rounds} rounds: {median:.2f} ({count} images of {images[0].nbytes / 1e6:.1f} MB)"
    )
    return median


def wait(folder: Path, steps: int) -> float:
    """Return the ratio of the median times until the images of one step are on the disk."""
    images, clock = noise(8), SystemClock()
    recorder = Recorder(folder / "steps.h5", header(), CAMERAS)
    descriptor = os.open(folder / "steps", os.O_CREAT | os.O_EXCL | os.O_WRONLY)
    waited: dict[str, list[float]] = {"plainly": [], "recorded": []}

    def plainly(step: list[tuple[str, Frame]]) -> None:
        for _, frame in step:
            os.write(descriptor, frame.image.data)
        os.fsync(descriptor)

    def recorded(step: list[tuple[str, Frame]]) -> None:
        for camera, frame in step:
            recorder.frame(camera, frame)
        recorder.synchronise().result(600)

    for number in range(steps):
        step = list(frames(images[2 * number % 8 :], 2))
        for write in (plainly, recorded) if number % 2 == 0 else (recorded, plainly):
            clock.sleep(PAUSE_S / 2)
            began_s = clock.now_s()
            write(step)
            waited[write.__name__].append(clock.now_s() - began_s)
    recorder.close("completed", "", START)
    os.close(descriptor)
    medians = {name: statistics.median(times) for name, times in waited.items()}
    ratio = medians["recorded"] / medians["plainly"]
    times = ", ".join(f"{name} {1e3 * s:.1f} ms" for name, s in sorted(medians.items()))
    print(f"two images of a step until they are on the disk: {times}, ratio {ratio:.2f} (median of {steps})")
    return ratio


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--folder", type=Path, help="where to write; a temporary folder by default")
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--images", type=int, default=200)
    parser.add_argument("--steps", type=int, default=31)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=given.folder) as folder:
        ratio = compare(Path(folder), given.rounds, given.images)
        longer = wait(Path(folder), given.steps)
    sys.exit(ratio < LEAST_RATIO or longer > MOST_WAIT)


if __name__ == "__main__":
    main()
