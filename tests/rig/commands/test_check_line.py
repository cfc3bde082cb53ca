"""`rig check --delay --line` on a box that measures the trigger or the exposure output of a camera."""

import math
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from drivers.clock import VirtualClock
from drivers.errors import DeviceTimeout
from drivers.interfaces import CameraInfo, Frame
from drivers.signals import Samples, Signal
from rig.commands.check_delay import measure_line_delay
from rig.devices import Rig
from rig.errors import RigError
from tests.command_line import run_rig
from tests.rig.channels.fake_box import BOX
from tests.rig.closed_rig import write_rig
from tests.rig.conftest import CAMERA, FakeOperator

DELAY_S, EXPOSURE_S = 0.0834, 0.02
IMAGE = np.zeros((48, 64), np.uint8)


@dataclass
class LineCamera:
    """Exposes at the given times; its stream tells that it is triggered, or the time between its frames."""

    clock: VirtualClock
    begins_s: np.ndarray
    interval_s: float = math.inf
    exposure_us: float = 1e6 * EXPOSURE_S
    info: CameraInfo = field(default_factory=lambda: replace(CAMERA, width_px=64, height_px=48))
    closed: bool = False
    number: int = 0

    def stream(self, capacity: int) -> "LineCamera":
        return self

    def next(self, timeout_s: float) -> Frame:
        self.number = max(self.number, int(np.searchsorted(self.begins_s, self.clock.now_s())))
        begin_s = float(self.begins_s[self.number])
        if begin_s + 0.03 - self.clock.now_s() > timeout_s:
            self.clock.sleep(timeout_s)
            raise DeviceTimeout("cameras.one", "stream", "a frame", "none", "trigger it")
        self.clock.sleep(begin_s + 0.03 - self.clock.now_s())
        self.number += 1
        now_s, middle_s = self.clock.now_s(), begin_s + EXPOSURE_S / 2
        utc = self.clock.utc()
        return Frame(IMAGE, begin_s, now_s, utc, self.number, 0, self.exposure_us, 1.0, middle_s, 1e-4)

    def close(self) -> None:
        self.closed = True


@dataclass
class LineBox:
    """Measures the line with a delay, in blocks of 500 samples per second, and counts its pulses."""

    clock: VirtualClock
    begins_s: np.ndarray
    signals: tuple[Signal, ...] = (
        Signal("line", "V", -1.0, 6.0),
        Signal("pulses", "pulses", 0.0, 1e9),
        Signal("force", "N", -1e3, 1e3),
    )
    rate_hz: float = 500.0
    info: object = BOX
    count: int = 0

    def read(self, timeout_s: float) -> Samples:
        times_s = (self.count + np.arange(25)) / self.rate_hz
        self.clock.sleep(times_s[-1] - self.clock.now_s())
        pulses = np.searchsorted(self.begins_s + DELAY_S, times_s)
        since_s = times_s - DELAY_S - np.append(-1.0, self.begins_s)[pulses]
        volts = 5.0 * (since_s < EXPOSURE_S)
        self.count += 25
        values = np.stack([volts, pulses, 0.0 * times_s], axis=1)
        return Samples(values, self.count - 25, self.clock.now_s(), device_s=times_s + 1000.0)

    def close(self) -> None:
        pass


def make_rig(begins_s: np.ndarray, **camera: float) -> Rig:
    clock = VirtualClock()
    cameras = {"one": LineCamera(clock, begins_s, **camera)}
    return Rig(clock, FakeOperator([]), cameras, channels={"box": LineBox(clock, begins_s)})


def irregular() -> np.ndarray:
    return np.cumsum(np.random.default_rng(1).uniform(0.1, 0.9, 400))


@pytest.mark.parametrize("signal", ["line", "pulses"])
def test_the_trigger_of_a_camera_gives_the_delay(signal):
    rig = make_rig(irregular())
    found = measure_line_delay(rig, signal, 30.0, rising=True)
    assert (found.problems, found.failed) == ([], {})
    delay = found.delays["one"]
    assert delay["edges"] > 40
    assert delay["delay_s"] == pytest.approx(DELAY_S, abs=2.0 * delay["mean_std_s"])
    assert delay["mean_std_s"] < 0.001
    assert "later than the beginning of the exposure" in found.lines[0]
    assert found.lines[-3] == f"[channels.box.signals.{signal}]"
    assert rig.cameras["one"].closed


def test_the_exposure_output_of_a_camera_that_runs_freely_leaves_whole_intervals_open():
    rig = make_rig(0.2 + 0.1 * np.arange(2000), interval_s=0.1)
    found = measure_line_delay(rig, "line", 20.0, rising=True)
    assert found.delays["one"]["delay_s"] == pytest.approx(DELAY_S, abs=0.002)
    assert "delays of -0.02, 0.18, 0.28 s fit as well; let the camera film more slowly" in found.problems[0]


def test_the_other_edge_is_the_end_of_the_exposures():
    """Of an output that is low during the exposure, `falling` must be given; here it is the wrong one."""
    found = measure_line_delay(make_rig(irregular()), "line", 30.0, rising=False)
    assert found.delays["one"]["delay_s"] == pytest.approx(DELAY_S + EXPOSURE_S, abs=0.002)


def test_what_cannot_be_measured_is_told():
    with pytest.raises(RigError, match=r"channels\.force: expected a signal that switches .* wire the line"):
        measure_line_delay(make_rig(irregular()), "force", 10.0, rising=True)
    unknown = measure_line_delay(make_rig(irregular(), exposure_us=math.nan), "line", 10.0, rising=True)
    assert "the exposure time is not known" in unknown.failed["cameras.one"]
    rig = make_rig(irregular())
    rig.cameras["one"].begins_s = rig.cameras["one"].begins_s + 1e6
    assert measure_line_delay(rig, "line", 20.0, rising=True).failed == {
        "cameras.one": "cameras.one: no image was taken"
    }


def test_the_command_takes_the_direction_of_the_edges(tmp_path):
    rig_file = write_rig(tmp_path)
    assert "--line only with --delay" in run_rig("check", rig_file, "--line", "rising").err
    done = run_rig("check", rig_file, "--delay", "channels.force", "--line", "rising", "--seconds", "5")
    assert done.status == 2
    assert "wire the line of the camera to this input" in done.err
