"""Record an endless run whose images overwrite older ones; `test_ring` starts and kills this program."""

import os
from pathlib import Path

import numpy as np

from drivers.interfaces import DeviceInfo
from drivers.signals import Signal
from rig.protocol.step import ProtocolStep, RigReading
from rig.recorder import Recorder, StepRecord
from rig.recorder.records import ChannelsRecord, SignalRecord
from rig.samples import TimedSamples
from tests.rig.recorder.forked_runs import serve
from tests.run_files import CAMERAS, HEADER, take

KEPT = 12
"""Number of images of each camera that stay; the tests' images have times that are 1 s apart."""
FIRST = 2
"""Number of steps before those whose images are overwritten."""
BLOCK = 5
STEPS_MAX = 100_000
BOX = ChannelsRecord(DeviceInfo("v", "m", "s"), (SignalRecord(Signal("force", "N", 0.0, 1e9)),))


def record(path: Path) -> None:
    """Record steps as fast as the disk acknowledges them."""
    recorder = Recorder(path, HEADER, CAMERAS, channels={"box": BOX})
    for index in range(STEPS_MAX):
        keep_s = None if index < FIRST else KEPT - 0.5
        frames = {
            name: (recorder.frame(name, take(info, index), keep_s), 1) for name, info in CAMERAS.items()
        }
        numbers = np.arange(BLOCK * index, BLOCK * (index + 1), dtype=np.float64)
        none = np.full(BLOCK, np.nan)
        recorder.samples("box", TimedSamples(numbers[:, None], numbers, 0.0 * numbers, none, BLOCK * index))
        kind = ("grid", "reference", "acquired")[min(index, 2)]
        written = recorder.step(StepRecord(ProtocolStep(index, kind), RigReading(float(index)), frames))
        written.result(60)
        # One write of a few bytes: the pipe takes it whole or not at all.
        os.write(1, b"step %d\n" % index)


if __name__ == "__main__":
    serve(record)
