"""A testing machine that takes no commands, its voltage, and a free-running camera; without code of `dic`.

The crosshead moves at one speed. The machine's controller refreshes its voltage 100 times per second. Each
refresh shows the load of an earlier moment: the machine's delay, with a jitter of 20 ms. Mains hum and white
noise are added on the way to a box that samples 1000 times per second by its own clock.
"""

from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from drivers.interfaces import CameraInfo, DeviceInfo, Frame
from drivers.signals import Signal
from rig.protocol.step import ProtocolStep, RigReading
from rig.recorder import Recorder, StepRecord
from rig.recorder.records import ChannelsRecord, SignalRecord
from rig.recording import RecordingSettings
from rig.samples import TimedSamples
from tests.dic.records.timed_tests import AREA_MM2, curve
from tests.run_files import HEADER, START

INFO = DeviceInfo("v", "m", "s")
CAMERA = CameraInfo("v", "m", "s", width_px=8, height_px=6, bits=8)
REFRESH_S, JITTER_S = 0.01, 0.02
REST_S = 2.0
ROOM = RecordingSettings(queue_frames=1000)


@dataclass(frozen=True)
class ClosedTest:
    """A tensile test beside a closed machine.

    `sample_s`, `volts_n`: the samples of the box, on the rig's clock as the program sees it, and in N.
    `middle_s`: middles of the exposures as the program sees them. `strain`, `load_n`: the truth at the
    exposures. `signal`: what the rig file declares. `e_gpa`, `rp02_mpa`: the truth about the specimen.
    """

    sample_s: np.ndarray
    volts_n: np.ndarray
    middle_s: np.ndarray
    strain: np.ndarray
    load_n: np.ndarray
    signal: Signal
    e_gpa: float
    rp02_mpa: float
    sample_std_s: float = 0.002
    middle_std_s: float = 0.001


def closed_test(seed, *, length_s=40.0, images=200, delay_std_s=0.01, noise_share=2e-3):
    """Return a random test. The declared delay is wrong by `delay_std_s`, and the clocks by less."""
    rng = np.random.default_rng([seed, 33])
    e_mpa, kind = rng.choice([70e3, 200e3]), ("ramberg-osgood", "bilinear", "plateau")[seed % 3]
    strains, stresses, rp02_mpa = curve(kind, e_mpa, rng)
    soft, top = rng.uniform(0.5, 6.0), rng.uniform(0.008, 0.015)
    ways = strains + soft * stresses / e_mpa
    speed = np.interp(top, strains, ways) / (length_s - REST_S)

    def state(time_s):
        strain = np.interp(speed * np.maximum(time_s - REST_S, 0.0), ways, strains)
        return strain, AREA_MM2 * np.interp(strain, strains, stresses)

    highest_n = AREA_MM2 * np.interp(top, strains, stresses)
    delay_s = rng.uniform(0.0, 0.2)
    box_s = np.arange(-1.0, length_s + 0.5, 1e-3)
    refresh_s = np.arange(-1.5, length_s + 1.0, REFRESH_S)
    shown_n = state(refresh_s - delay_s - JITTER_S * rng.normal(size=len(refresh_s)))[1]
    volts_n = shown_n[np.searchsorted(refresh_s, box_s, "right") - 1]
    hum = rng.uniform(0.0, 0.01) * np.sin(2 * np.pi * rng.choice([50.0, 60.0]) * box_s + rng.uniform(0, 6))
    volts_n = volts_n + highest_n * (hum + noise_share * rng.normal(size=len(box_s)))
    clock_s = 0.002 * rng.normal()
    # A voltage is held for one refresh, half of which delays it in the mean.
    declared_s = delay_s + 0.5 * REFRESH_S + delay_std_s * rng.normal()
    force = Signal("force", "N", -2e3, 1e5, max(0.0, declared_s), delay_std_s)
    exposed_s = np.linspace(0.3, length_s - 0.3, images) + 0.02 * rng.uniform(-1, 1, images)
    strain, load_n = state(exposed_s)
    middle_s = exposed_s + 0.001 * rng.normal(size=images)
    return ClosedTest(box_s + clock_s, volts_n, middle_s, strain, load_n, force, e_mpa / 1e3, float(rp02_mpa))


def write_test(path: Path, test: ClosedTest, **header: object) -> Path:
    """Record a test: a step for the grid, the reference, and a step for each image after the first."""
    record = {"box": ChannelsRecord(INFO, (SignalRecord(test.signal, "load"),))}
    recorder = Recorder(path, replace(HEADER, **header), {"front": CAMERA}, channels=record, settings=ROOM)
    blank = np.zeros((CAMERA.height_px, CAMERA.width_px), np.uint8)
    blank.flags.writeable = False
    device_s = test.sample_s - test.sample_s[0]
    stds_s = np.full(len(device_s), test.sample_std_s)
    for first in range(0, len(device_s), 1000):
        part = slice(first, first + 1000)
        columns = test.volts_n[part, None], test.sample_s[part], stds_s[part], device_s[part]
        recorder.samples("box", TimedSamples(*columns, first))
    kinds = ["grid", "reference", *["acquired"] * (len(test.middle_s) - 1)]
    for index, kind in enumerate(kinds):
        middle_s = float(test.middle_s[max(0, index - 1)])
        frame = Frame(
            blank, middle_s - 0.01, middle_s + 0.02, START, index, 0, 5e3, 1.0, middle_s, test.middle_std_s
        )
        rows = {"front": (recorder.frame("front", frame), 1)}
        recorder.step(StepRecord(ProtocolStep(index, kind), RigReading(middle_s), rows, middle_s))
    recorder.close("completed", "", START)
    with suppress(OSError):
        path.chmod(0o644)
    return path
