"""`rig check --delay` on a simulated light, cameras with a stream or without one, and a box with a delay."""

from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
import pytest

from drivers.clock import VirtualClock
from drivers.errors import DeviceFault, LinkLost
from drivers.interfaces import CameraInfo, Frame
from drivers.signals import Samples, Signal
from rig.commands.check_delay import measure_delay
from rig.devices import Rig
from rig.errors import RigError
from tests.command_line import run_rig
from tests.rig.channels.fake_box import BOX
from tests.rig.closed_rig import write_rig
from tests.rig.conftest import CAMERA, FakeOperator
from tests.rig.engine.fake_stream import FakeReport

LIGHT = Signal("light", "V", -1.0, 6.0)
INFO = replace(CAMERA, width_px=64, height_px=48)


class Light:
    """A light that is switched at irregular times; `on(t)` is its state."""

    def __init__(self, seed: int = 1) -> None:
        self.times_s = np.cumsum(np.random.default_rng(seed).uniform(0.2, 0.9, 400))

    def on(self, time_s: float) -> bool:
        return bool(np.searchsorted(self.times_s, time_s) % 2)

    def share(self, begin_s: float, end_s: float) -> float:
        """Return the part of an exposure with light."""
        edges = [begin_s, *self.times_s[(self.times_s > begin_s) & (self.times_s < end_s)], end_s]
        lit = sum(b - a for a, b in pairwise(edges) if self.on((a + b) / 2))
        return lit / (end_s - begin_s)


@dataclass
class LitCamera:
    """Exposes for 8 ms every `period_s`; the lower right corner shows the light, the rest is still."""

    clock: VirtualClock
    light: Light
    period_s: float = 0.031
    late_s: float = 0.0
    info: CameraInfo = INFO
    number: int = 0
    fails: bool = False

    def frame(self) -> Frame:
        if self.fails and self.clock.now_s() > 10.0:
            raise LinkLost("cameras.one", "grab", "a frame", "none", "plug it in")
        self.number = max(self.number + 1, int(self.clock.now_s() / self.period_s) + 1)
        begin_s = self.number * self.period_s
        self.clock.sleep(begin_s + 0.015 - self.clock.now_s())
        noise = np.random.default_rng(self.number).normal(0.0, 1.0, (48, 64))
        image = 60.0 + noise
        image[30:, 40:] += 100.0 * self.light.share(begin_s, begin_s + 0.008)
        middle_s = begin_s + 0.004 + self.late_s
        now_s = self.clock.now_s()
        return Frame(
            image.astype(np.uint8),
            begin_s,
            now_s,
            self.clock.utc(),
            self.number,
            0,
            8000.0,
            1.0,
            middle_s,
            1e-4,
        )

    def grab(self, timeout_s: float) -> Frame:
        return self.frame()

    def close(self) -> None:
        pass


class StreamingLitCamera(LitCamera):
    closed = False

    def stream(self, capacity: int) -> "StreamingLitCamera":
        return self

    def next(self, timeout_s: float) -> Frame:
        return self.frame()

    def report(self) -> FakeReport:
        return FakeReport()

    def close(self) -> None:
        self.closed = True


@dataclass
class LitBox:
    """Shows the voltage of the light with a delay, in blocks of 500 samples per second with own times."""

    clock: VirtualClock
    light: Light
    delay_s: float = 0.0834
    fails: bool = False
    signals: tuple[Signal, ...] = (Signal("other", "mm", -1.0, 1.0), LIGHT)
    rate_hz: float = 500.0
    info: object = BOX
    count: int = 0
    noise: np.random.Generator = field(default_factory=lambda: np.random.default_rng(3))

    def read(self, timeout_s: float) -> Samples:
        if self.fails and self.clock.now_s() > 10.0:
            raise DeviceFault("channels.box", "read", "a value", "none", "check the box")
        times_s = (self.count + np.arange(25)) / self.rate_hz
        self.clock.sleep(times_s[-1] + 0.003 - self.clock.now_s())
        volts = [5.0 * self.light.on(time_s - self.delay_s) for time_s in times_s]
        values = np.stack([0.0 * times_s, volts + 0.02 * self.noise.normal(size=25)], axis=1)
        self.count += 25
        return Samples(values, self.count - 25, self.clock.now_s(), device_s=times_s + 1000.0)

    def close(self) -> None:
        pass


def make_rig(kind=LitCamera, count=1, box=None, **camera) -> Rig:
    clock, light = VirtualClock(), Light()
    box = LitBox(clock, light) if box is None else box(clock, light)
    cameras = {name: kind(clock, light, **camera) for name in ("one", "two")[:count]}
    return Rig(clock, FakeOperator([]), cameras, channels={"box": box})


@pytest.mark.parametrize("kind", [LitCamera, StreamingLitCamera])
def test_the_delay_of_the_box_is_measured_and_said_for_the_rig_file(kind):
    rig = make_rig(kind)
    said = []
    found = measure_delay(rig, "light", 30.0, said.append)
    assert (found.problems, found.failed) == ([], {})
    assert "irregular times, for 30 s" in said[0]
    delay = found.delays["one"]
    assert delay["edges"] > 40
    # The samples of the box come 3 ms after they were taken, which no record of them shows.
    assert delay["delay_s"] == pytest.approx(0.0834 + 0.003, abs=4.0 * delay["mean_std_s"])
    assert delay["mean_std_s"] < 0.0015
    assert found.lines[-3] == "[channels.box.signals.light]"
    assert float(found.lines[-2].split(" = ")[1]) == pytest.approx(delay["delay_s"], abs=1e-4)
    assert float(found.lines[-1].split(" = ")[1]) == pytest.approx(delay["delay_std_s"], abs=1e-5)
    if kind is StreamingLitCamera:
        assert rig.cameras["one"].closed


def test_a_camera_whose_times_are_wrong_is_told():
    rig = make_rig(count=2)
    rig.cameras["two"].late_s = 0.02
    found = measure_delay(rig, "light", 30.0)
    assert any("differs by 20 ms from that of another camera" in problem for problem in found.problems)
    early = measure_delay(make_rig(late_s=0.15), "light", 30.0)
    assert early.delays["one"]["delay_s"] == pytest.approx(0.0834 + 0.003 - 0.15, abs=0.005)
    assert "no delay_s can state this" in early.problems[0]
    assert "delay_s = 0.0" in early.lines


def test_a_camera_that_fails_leaves_the_other_one():
    rig = make_rig(count=2)
    rig.cameras["one"].fails = True
    found = measure_delay(rig, "light", 30.0)
    assert "plug it in" in found.failed["cameras.one"]
    assert list(found.delays) == ["two"]


def test_a_channel_that_fails_ends_the_measurement():
    rig = make_rig(box=lambda clock, light: LitBox(clock, light, fails=True))
    with pytest.raises(DeviceFault, match="check the box"):
        measure_delay(rig, "light", 30.0)


def test_what_does_not_switch_is_refused_in_one_sentence():
    with pytest.raises(
        RigError, match=r"^channels\.other: expected a signal that switches .* wire the voltage"
    ):
        measure_delay(make_rig(), "other", 10.0)
    rig = make_rig()
    rig.cameras["one"].light = Light(2)
    rig.cameras["one"].light.times_s = np.array([1e9])
    found = measure_delay(rig, "light", 10.0)
    assert found.delays == {}
    assert "0 edges in" in found.failed["cameras.one"]
    assert found.lines == []


def test_another_light_in_view_is_refused():
    rig = make_rig()
    rig.cameras["one"].light = Light(2)
    found = measure_delay(rig, "light", 30.0)
    assert "the channel must show the voltage of the light" in found.failed["cameras.one"]


def test_the_command_names_the_channels_it_knows_and_refuses_a_light_that_stands_still(tmp_path):
    done = run_rig("check", write_rig(tmp_path), "--delay", "channels.froce")
    assert done.status == 2
    assert "--delay with a signal of the rig (channels.force)" in done.err
    done = run_rig(
        "check",
        write_rig(tmp_path, ("start_s = 2.0", "start_s = 1000.0")),
        "--delay",
        "force",
        "--seconds",
        "5",
    )
    assert done.status == 2
    assert "without edges" in done.err
    assert run_rig("check", write_rig(tmp_path), "--seconds", "9").status == 2
