"""Channels of a run: every fault is seen, nothing hangs, and no sample is lost or changed."""

import threading
from dataclasses import dataclass, field, replace

import h5py
import numpy as np
import pytest

from drivers.clock import SystemClock, VirtualClock
from drivers.errors import DeviceTimeout
from drivers.signals import Samples, Signal
from rig.channels.run_channels import RunChannels
from tests.rig.channels.fake_box import BOX, FORCE, FakeBox
from tests.rig.engine.test_acquisition import BARE, SHORTEST, beside, steps, with_tables


@dataclass
class BlockBox:
    """A box with a clock of its own, which delivers its samples in blocks, in one buffer again and again."""

    clock: VirtualClock
    value_of: object
    signals: tuple[Signal, ...] = (replace(FORCE, delay_s=0.0),)
    rate_hz: float = 1000.0
    block: int = 100
    info: object = BOX
    reads: int = 0
    buffer: np.ndarray = field(default_factory=lambda: np.zeros((100, 1)))

    def read(self, timeout_s: float) -> Samples:
        first = self.reads * self.block
        times_s = (first + np.arange(self.block)) / self.rate_hz
        self.clock.sleep(times_s[-1] - self.clock.now_s())
        self.reads += 1
        self.buffer[:, 0] = [self.value_of(time_s) for time_s in times_s]
        return Samples(self.buffer, first, self.clock.now_s(), device_s=times_s + 77.0)

    def close(self) -> None:
        pass


def in_blocks(tmp_path, text, value_of):
    rig = beside(tmp_path, text)
    rig.channels = {"box": BlockBox(rig.clock, value_of)}
    return rig


def test_each_edge_in_a_block_of_samples_gives_one_image(tmp_path):
    """A pulse of 10 ms, which begins and ends within one block, must not be found again and again."""
    text = with_tables('trigger = { channel = "channels.force", above = 5 }', "duration_s = 10")
    rig = in_blocks(tmp_path, text, lambda t: 10.0 if 0.030 <= t % 1.0 < 0.040 else 0.0)
    outcome = rig.engine().run()
    assert outcome.is_good, outcome.reason
    assert outcome.timing.asked == 10
    np.testing.assert_allclose(np.diff(steps(rig.path)[0]["due_s"]), 1.0, atol=0.003)


def test_jumps_within_a_block_give_one_image_each(tmp_path):
    """At a jump over several increments, the samples before it must not count as a way back."""
    text = with_tables('increment = { channel = "channels.force", by = 100 }', "duration_s = 4")
    rig = in_blocks(tmp_path, text, lambda t: 1000.0 * np.floor(t + 0.53))
    outcome = rig.engine().run()
    assert outcome.is_good, outcome.reason
    # the first one, and one at each jump
    assert outcome.timing.asked == 5


def test_samples_in_the_file_are_those_that_were_read_although_the_driver_reuses_its_buffer(tmp_path):
    rig = in_blocks(tmp_path, BARE + SHORTEST, lambda t: 100.0 * t)
    assert rig.engine().run().is_good
    box = steps(rig.path)[2]
    assert (np.diff(box["number"]) == 1).all()
    np.testing.assert_allclose(box["value_force"], 100.0 * (box["device_s"] - 77.0), atol=1e-6)


def test_samples_reach_the_last_image_although_they_come_late(tmp_path):
    rig = beside(tmp_path)
    rig.channels["box"].signals = (replace(FORCE, delay_s=1.5),)
    assert rig.engine().run().is_good
    _, camera, box = steps(rig.path)
    assert box["time_s"][-1] - 1.5 > camera["middle_s"][-1] + 0.2


def test_lost_samples_are_told_seldom_and_all_are_counted(tmp_path):
    rig = beside(tmp_path, on_read=lambda count, s: replace(s, first=2 * s.first))
    outcome = rig.engine().run()
    told = [event for event in rig.events() if "were lost" in event]
    assert 2 <= len(told) <= 4
    lost = int((np.diff(steps(rig.path)[2]["number"]) - 1).sum())
    assert outcome.lost_samples == {"box": lost}
    assert sum(int(event.split(": ")[1].split()[0]) for event in told) == lost


def test_a_slow_device_has_time_for_its_first_sample(tmp_path):
    text = with_tables("every_s = 5", "duration_s = 60")
    rig = beside(tmp_path, text)
    rig.channels = {"box": FakeBox(rig.clock, lambda t: 1.0, rate_hz=0.1, due_s=10.0)}
    outcome = rig.engine().run()
    assert outcome.is_good, outcome.reason


def test_a_device_without_a_first_sample_ends_the_run_and_an_abort_does_not_wait_for_it(tmp_path):
    def silent(count, samples):
        raise DeviceTimeout("channels.box", "read", "a message", "none", "look at the broker")

    rig = beside(tmp_path)
    rig.channels = {"box": FakeBox(rig.clock, lambda t: 1.0, rate_hz=10.0, on_read=silent)}
    engine = rig.engine()
    outcome = engine.run()
    assert outcome.status == "failed"
    assert "look at the broker" in outcome.reason

    other = beside(tmp_path / "x")
    other.path.parent.mkdir()

    def abort(count, samples):
        if other.clock.now_s() > 2.0:
            threading.Thread(target=engine.abort, args=("the test wants it",)).start()
        raise DeviceTimeout("channels.box", "read", "a message", "none", "look at the broker")

    other.channels = {"box": FakeBox(other.clock, lambda t: 1.0, rate_hz=10.0, on_read=abort)}
    other.channels["box"].rate_hz = 0.05
    engine = other.engine()
    assert engine.run().status == "aborted"
    assert other.clock.now_s() < 25.0


class Hanging:
    """A device without a fixed rate, whose third call of `read` never returns."""

    info = BOX
    signals = (FORCE,)
    rate_hz = 0.0

    def __init__(self, over: threading.Event) -> None:
        self.over, self.reads = over, 0

    def read(self, timeout_s: float) -> Samples:
        self.reads += 1
        if self.reads == 3:
            self.over.wait(60.0)
        now_s = SystemClock().now_s()
        return Samples(np.array([[1.0]]), self.reads - 1, now_s, asked_s=now_s)

    def close(self) -> None:
        pass


def test_a_call_that_hangs_is_seen_also_without_a_fixed_rate_and_at_the_end():
    over, clock = threading.Event(), SystemClock()
    channels = RunChannels({"box": Hanging(over)}, clock, hang_s=0.1)
    channels.begin()
    try:
        with pytest.raises(DeviceTimeout, match=r"^channels\.box: read: .* the call hangs"):
            [(channels.read(), clock.sleep(0.02)) for _ in range(100)]
        assert channels.end() == {"channels.box": "read, which has not returned at the end of the run"}
    finally:
        over.set()


def test_a_device_whose_driver_hangs_at_the_end_is_not_closed(tmp_path):
    over = threading.Event()
    rig = beside(tmp_path)

    def hang(count, samples):
        if rig.clock.now_s() > 5.0 and not over.is_set():
            threading.Thread(target=rig.engine_of_test.abort, args=("enough",)).start()
            over.wait(60.0)
        return samples

    rig.channels["box"].on_read = hang
    rig.engine_of_test = rig.engine()
    outcome = rig.engine_of_test.run()
    over.set()
    assert outcome.status == "aborted"
    assert [
        lost for lost in outcome.lost_devices if lost.startswith("channels.box: its driver hangs in read")
    ]


def test_a_slow_disk_does_not_end_a_simulated_run_that_is_faster(tmp_path, monkeypatch):
    """The wait for the disk has a deadline in real time; simulated time passes much faster."""
    from rig.recorder.file import OpenRunFile

    real = OpenRunFile.synchronise

    def slow(self):
        threading.Event().wait(0.1)
        real(self)

    monkeypatch.setattr(OpenRunFile, "synchronise", slow)
    rig = beside(tmp_path, with_tables("every_s = 20", "images = 40"), lambda t: 1.0)
    outcome = rig.engine().run()
    assert outcome.is_good, outcome.reason
    assert rig.clock.now_s() > 700.0


def test_space_for_a_block_of_samples_is_enough(tmp_path, monkeypatch):
    """The recorder reserves the space of a block before it is written, so that no write can fail."""
    from rig.recorder.file import OpenRunFile

    real_require, real_commit = OpenRunFile.require_space, OpenRunFile.commit
    ends, grown = [0], []

    def require(self, size):
        ends.append(self._hdf5.id.get_filesize() + size)
        real_require(self, size)

    def commit(self):
        before = self._hdf5.id.get_filesize()
        real_commit(self)
        size = self._hdf5.id.get_filesize()
        assert size <= ends[-1]
        grown.append(size - before)

    monkeypatch.setattr(OpenRunFile, "require_space", require)
    monkeypatch.setattr(OpenRunFile, "commit", commit)
    rig = beside(tmp_path)
    box = BlockBox(rig.clock, lambda t: 1.0, rate_hz=1e5, block=50_000)
    box.buffer = np.zeros((50_000, 1))
    rig.channels = {"box": box}
    assert rig.engine().run().is_good
    with h5py.File(rig.path) as file:
        assert len(file["entry/channels/box/number"]) >= 1e6
    assert max(grown) > 2e6
